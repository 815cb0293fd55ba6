"""Makes the gripper with two fingers: `python -m crossmodal.models.make_gripper`.

Its taxels lie where `gripper_taxels` says.
"""

from collections.abc import Sequence

import numpy as np

from crossmodal.maths.arrays import Array
from crossmodal.models import SDF_DIR
from crossmodal.models.gripper_taxels import (
    ARRAYS,
    FINGERS,
    PITCH,
    RADIUS,
    STICKS_OUT,
    THICKNESS,
    TIP_STICKS_OUT,
    TRAVEL,
    WIDTH,
    gripper_taxels,
)

GRIPPER_FILE = SDF_DIR / "two_finger_gripper.sdf"

_PALM_RADIUS, _PALM_LENGTH = 0.0375, 0.09  # [m].
_REACH = 0.13  # Of the fingers beyond the palm, [m].
_RAIL = (0.17, 0.036, 0.024)  # On which the fingers slide, [m].
_RAIL_TOP = 0.102  # Along z of the palm, [m].
_PALM_MASS, _FINGER_MASS = 0.8, 0.1  # [kg].
_EFFORT, _STIFFNESS, _DAMPING = 10.0, 2000.0, 60.0  # Of a finger's drive: [N], [N/m], [N s/m].
_DARK, _GREY, _SKIN = "0.16 0.17 0.19 1", "0.45 0.46 0.48 1", "0.30 0.32 0.35 1"
_HEAD = """<!-- Made by crossmodal.models.make_gripper.
     A gripper with two fingers that slide. Stroke (140 mm), width of the fingers and mass (1 kg)
     are those of a Robotiq 2F-140, whose fingers swing, however. Each finger has a drive that
     pushes with 10 N at most, the least to which that gripper can be set; 0 is closed.
     On each finger are 70 taxels in four arrays, as on XELA's fingers: phalange 4x6, outer 4x6,
     tip 2x3, inner 4x4. Each is a sphere of 3 mm radius with a point contact of its own, 4.7 mm
     from its neighbours; it sticks out of the finger's core by 1.5 mm. Those of a tip are 8 and
     10.5 mm apart, so that they reach to the edges of its end (14 x 27 mm), and stick out by 4.5
     mm: what meets a finger's end from the front or a side meets a taxel before the core. Where
     all of them are says models/gripper_taxels.py.
     Frame E (end_effector): z along the fingers, x along the opening, its origin in the middle of
     the closed fingers' ends, where the taxels reach furthest. -->"""


def sdf() -> str:
    """The model file."""
    palm = [
        _inertial((0.0, 0.0, 0.05), _PALM_MASS, _cylinder_moments(_PALM_MASS)),
        *_shape("body", (0.0, 0.0, 0.5 * _PALM_LENGTH), _cylinder(), _DARK),
        *_shape("rail", (0.0, 0.0, _RAIL_TOP - 0.5 * _RAIL[2]), _box(_RAIL), _GREY),
    ]
    fingers = [line for finger in FINGERS for line in _finger(finger)]
    end = _PALM_LENGTH + _REACH
    lines = [
        '<?xml version="1.0"?>',
        _HEAD,
        '<sdf version="1.9" xmlns:drake="drake.mit.edu">',
        '  <model name="gripper">',
        '    <link name="palm">',
        *palm,
        "    </link>",
        *fingers,
        f'    <frame name="end_effector" attached_to="palm">{_pose((0.0, 0.0, end))}</frame>',
        "  </model>",
        "</sdf>",
    ]
    return "\n".join(lines) + "\n"


def _finger(finger: str) -> list[str]:
    """A finger and its joint; its frame is where E is when it is closed."""
    outwards = 1.0 if finger == "left" else -1.0
    start = _RAIL_TOP - _PALM_LENGTH - _REACH
    length = -TIP_STICKS_OUT - start
    size = (THICKNESS - 2.0 * STICKS_OUT, WIDTH - 2.0 * STICKS_OUT, length)
    middle = (0.5 * outwards * THICKNESS, 0.0, start + 0.5 * length)
    core = "<drake:proximity_properties>" + _friction(0.5) + "</drake:proximity_properties>"
    palm_to_finger = (0.0, 0.0, _PALM_LENGTH + _REACH)
    lines = [
        f'    <link name="{finger}_finger">',
        f"      {_pose(palm_to_finger, 'palm')}",
        _inertial(middle, _FINGER_MASS, _box_moments(_FINGER_MASS, size)),
        *_shape("core", middle, _box(size), _GREY, core),
    ]
    taxels = gripper_taxels()
    skin = (
        "<drake:proximity_properties><drake:point_contact_stiffness>3000"
        "</drake:point_contact_stiffness><drake:hunt_crossley_dissipation>5"
        "</drake:hunt_crossley_dissipation>" + _friction(0.8) + "</drake:proximity_properties>"
    )
    for index, array in enumerate(ARRAYS):
        if not array.startswith(finger):
            continue
        ours = np.flatnonzero(taxels.array == index)
        lines.append(_patch(array, taxels.p_FS[ours], taxels.n_F[ours[0]]))
        for k in ours:
            sphere = f"<geometry><sphere><radius>{RADIUS:g}</radius></sphere></geometry>"
            place = _pose(taxels.p_FS[k])
            lines.append(
                f'      <collision name="{taxels.names[k]}">{place}{sphere}{skin}</collision>'
            )
    limit = f"<lower>0</lower><upper>{TRAVEL:g}</upper><velocity>0.15</velocity>"
    return [
        *lines,
        "    </link>",
        f'    <joint name="{finger}_joint" type="prismatic">',
        f"      <parent>palm</parent><child>{finger}_finger</child>",
        f"      <axis><xyz>{outwards:g} 0 0</xyz>"
        f"<limit>{limit}<effort>{_EFFORT:g}</effort></limit></axis>",
        f'      <drake:controller_gains p="{_STIFFNESS:g}" d="{_DAMPING:g}"/>',
        "    </joint>",
    ]


def _patch(array: str, p_FS: Array, n_F: Array) -> str:
    """What is seen of an array: a thin box over its taxels, as high as they are."""
    low, high = p_FS.min(axis=0), p_FS.max(axis=0)
    along = np.abs(n_F) > 0.5
    is_tip = array.endswith("tip")
    beside, thickness = (RADIUS, TIP_STICKS_OUT) if is_tip else (0.5 * PITCH, STICKS_OUT)
    size = np.where(along, thickness, high - low + 2.0 * beside)
    middle = 0.5 * (low + high) + (RADIUS - 0.5 * thickness) * n_F
    return _visual(array, tuple(middle), _box(tuple(size)), _SKIN)


def _shape(
    name: str, place: Sequence[float], geometry: str, color: str, properties: str = ""
) -> list[str]:
    shape = f'<collision name="{name}">{_pose(place)}{geometry}{properties}</collision>'
    return [_visual(name, place, geometry, color), f"      {shape}"]


def _visual(name: str, place: Sequence[float], geometry: str, color: str) -> str:
    material = f"<material><diffuse>{color}</diffuse></material>"
    return f'      <visual name="{name}">{_pose(place)}{geometry}{material}</visual>'


def _pose(place: Sequence[float] | Array, frame: str = "") -> str:
    relative = f' relative_to="{frame}"' if frame else ""
    return f"<pose{relative}>{_numbers(place)} 0 0 0</pose>"


def _box(size: Sequence[float]) -> str:
    return f"<geometry><box><size>{_numbers(size)}</size></box></geometry>"


def _cylinder() -> str:
    size = f"<radius>{_PALM_RADIUS:g}</radius><length>{_PALM_LENGTH:g}</length>"
    return f"<geometry><cylinder>{size}</cylinder></geometry>"


def _friction(mu: float) -> str:
    static = f"<drake:mu_static>{mu:g}</drake:mu_static>"
    return f"{static}<drake:mu_dynamic>{mu:g}</drake:mu_dynamic>"


def _inertial(middle: Sequence[float], mass: float, moments: Sequence[float]) -> str:
    inertia = "".join(
        f"<i{axis}{axis}>{moment:.4e}</i{axis}{axis}>"
        for axis, moment in zip("xyz", moments, strict=True)
    )
    return (
        f"      <inertial>{_pose(middle)}<mass>{mass:g}</mass>"
        f"<inertia>{inertia}</inertia></inertial>"
    )


def _cylinder_moments(mass: float) -> tuple[float, float, float]:
    across = mass * (3.0 * _PALM_RADIUS**2 + _PALM_LENGTH**2) / 12.0
    return across, across, 0.5 * mass * _PALM_RADIUS**2


def _box_moments(mass: float, size: Sequence[float]) -> tuple[float, float, float]:
    x, y, z = (mass * extent**2 / 12.0 for extent in size)
    return y + z, x + z, x + y


def _numbers(values: Sequence[float] | Array) -> str:
    return " ".join(f"{round(float(x), 6) + 0.0:g}" for x in values)


if __name__ == "__main__":
    GRIPPER_FILE.write_text(sdf(), encoding="utf-8")
