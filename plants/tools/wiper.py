"""A wiper: a bar to hold it by, a bracket, and a flap on a hinge below it."""

from dataclasses import dataclass

import numpy as np

from crossmodal.maths.arrays import Array
from crossmodal.maths.validation import check, numbers, require

HINGE, HANDLE_FRAME, EDGE_FRAME, FLAP = "hinge", "handle", "edge", "flap"

_DENSITY = 1200.0  # Of the plastic that all but the rail is made of, [kg/m^3].
_RAIL_MASS = 0.12  # Of the flap's metal rail, which lies along the hinge, [kg].
_RAIL_RADIUS = 0.006  # [m]
_BAR_END = 0.08  # Of the handle's bar above the place where it is held, [m].
_PLATE = 0.004  # Thickness of the bracket's plate, [m].
_UPPER_STOP, _LOWER_STOP = 2.6, -0.35  # Of the hinge, [rad].
# The hinge's friction is a drive that brakes with the friction's torque at most. At this damping a
# flap that hangs on half of it creeps by 0.1 deg in 30 s, [N m s/rad].
_BRAKE = 100.0
# Steel or hard plastic, smooth enough that a soft fingertip holds on to it.
_FRICTION = 0.9


@dataclass(kw_only=True)
class WiperConfig:
    """From where to where each quantity of a wiper is drawn, uniformly."""

    flap_length: np.ndarray = numbers(  # From the hinge to the free edge.
        np.array([0.070, 0.100]), at_least=0.03, at_most=0.3, unit="m"
    )
    flap_width: np.ndarray = numbers(  # Along the hinge.
        np.array([0.160, 0.240]), at_least=0.05, at_most=0.6, unit="m"
    )
    # Of the flap's plate.
    flap_thickness: np.ndarray = numbers(
        np.array([0.005, 0.008]), at_least=0.002, at_most=0.03, unit="m"
    )
    # By how much the flap's middle plane lies before the hinge.
    hinge_offset: np.ndarray = numbers(
        np.array([-0.004, 0.006]), at_least=-0.03, at_most=0.03, unit="m"
    )
    # Coulomb friction of the hinge.
    friction: np.ndarray = numbers(np.array([0.006, 0.012]), at_least=0.0, at_most=1.0, unit="N m")
    # Torque of the flap's weight when it is level; it is a small rest, for the rail balances it.
    imbalance: np.ndarray = numbers(np.array([0.0, 0.004]), at_least=-1.0, at_most=1.0, unit="N m")
    # Viscous friction of the hinge.
    damping: np.ndarray = numbers(
        np.array([0.0, 0.002]), at_least=0.0, at_most=1.0, unit="N m s/rad"
    )
    # Of the handle's square bar.
    bar: np.ndarray = numbers(np.array([0.018, 0.024]), at_least=0.01, at_most=0.04, unit="m")
    # Of the place where the handle is held above the hinge.
    grip_height: np.ndarray = numbers(np.array([0.15, 0.19]), at_least=0.1, at_most=0.5, unit="m")


@dataclass(frozen=True, kw_only=True)
class Wiper:
    """The numbers of one wiper; see `WiperConfig`."""

    flap_length: float
    flap_width: float
    flap_thickness: float
    hinge_offset: float
    friction: float
    imbalance: float
    damping: float
    bar: float
    grip_height: float


def draw_wiper(config: WiperConfig, rng: np.random.Generator) -> Wiper:
    """The wiper of a seed.

    Raises:
        ValueError: for a range that is impossible or upside down.
    """
    name = "WiperConfig"
    check(config, name)
    share = rng.random(len(vars(config)))
    drawn = {}
    for u, (field, ends) in zip(share, vars(config).items(), strict=True):
        low, high = np.asarray(ends).tolist()
        require(low <= high, name, config, field, "two numbers, the lower one first")
        drawn[field] = low + u * (high - low)
    return Wiper(**drawn)


def wiper_sdf(wiper: Wiper) -> str:
    """The model of a wiper, as SDF.

    Its frame has its origin in the middle of the hinge, x towards the side that is seen, y against
    the hinge's axis and z up; the flap hangs down when the hinge is at 0 and swings towards x and
    up when it turns. Frames: `handle` in the bar where it is to be held, `edge` in the middle of
    the flap's free edge, both with the model's axes.
    """
    w = wiper
    bar_length = w.grip_height + _BAR_END
    bar_x = -0.5 * w.bar - _PLATE
    gap = _RAIL_RADIUS
    plate_height = w.flap_length - gap
    bar_volume, bracket = (w.bar, w.bar, bar_length), (_PLATE, 0.12, 0.06)
    flap = (w.flap_thickness, w.flap_width, plate_height)
    flap_mass = _DENSITY * float(np.prod(flap)) + _RAIL_MASS
    arm = w.imbalance / (9.81 * flap_mass)
    flap_inertia = (
        _box_inertia(flap_mass - _RAIL_MASS, flap)
        + np.array([1.0, 0.0, 1.0]) * _RAIL_MASS * w.flap_width**2 / 12.0
    )
    about_hinge = (flap_mass - _RAIL_MASS) * (0.5 * w.flap_length) ** 2
    flap_inertia += np.array([about_hinge, about_hinge, 0.0])
    body_mass = _DENSITY * float(np.prod(bar_volume) + np.prod(bracket))
    bar_z = 0.5 * bar_length + 0.012
    parts = (
        _box("textured_bracket", (-0.5 * _PLATE, 0.0, 0.042), bracket, "0.8 0.8 0.8", ""),
        _box("bar", (bar_x, 0.0, bar_z), bar_volume, "0.55 0.57 0.6", _rigid(1.0)),
    )
    flap_at = (w.hinge_offset, 0.0, -gap - 0.5 * plate_height)
    rail = _cylinder("rail", _RAIL_RADIUS, w.flap_width, "0.4 0.41 0.43")
    flap_parts = (_box("textured_flap", flap_at, flap, "0.8 0.8 0.8", _rigid(1.0)), rail)
    return f"""<?xml version="1.0"?>
<sdf version="1.9" xmlns:drake="drake.mit.edu">
  <model name="wiper">
    <link name="body">
      {_inertial(body_mass, (bar_x, 0.0, bar_z), _box_inertia(body_mass, bar_volume))}
      {"".join(parts)}
    </link>
    <link name="{FLAP}">
      {_inertial(flap_mass, (0.0, 0.0, -arm), flap_inertia)}
      {"".join(flap_parts)}
    </link>
    <joint name="{HINGE}" type="revolute">
      <parent>body</parent><child>{FLAP}</child>
      <axis><xyz>0 -1 0</xyz>
        <limit><lower>{_LOWER_STOP}</lower><upper>{_UPPER_STOP}</upper>
          <effort>{max(w.friction, 1e-6):.6g}</effort></limit>
        <dynamics><damping>{w.damping:.6g}</damping></dynamics></axis>
      <drake:controller_gains p="0" d="{_BRAKE:g}"/>
    </joint>
    <frame name="{HANDLE_FRAME}" attached_to="body">
      <pose>{bar_x:.6g} 0 {w.grip_height:.6g} 0 0 0</pose></frame>
    <frame name="{EDGE_FRAME}" attached_to="{FLAP}">
      <pose>{w.hinge_offset:.6g} 0 {-w.flap_length:.6g} 0 0 0</pose></frame>
  </model>
</sdf>
"""


def _box_inertia(mass: float, size: tuple[float, float, float]) -> Array:
    x, y, z = np.square(size)
    return mass / 12.0 * np.array([y + z, x + z, x + y])


def _inertial(mass: float, p: tuple[float, float, float], inertia: Array) -> str:
    xx, yy, zz = inertia
    return (
        f"<inertial><pose>{_text(p)} 0 0 0</pose><mass>{mass:.6g}</mass>"
        f"<inertia><ixx>{xx:.6g}</ixx><iyy>{yy:.6g}</iyy><izz>{zz:.6g}</izz></inertia></inertial>"
    )


def _rigid(resolution: float) -> str:
    return (
        "<drake:proximity_properties><drake:rigid_hydroelastic/>"
        f"<drake:mesh_resolution_hint>{resolution}</drake:mesh_resolution_hint>"
        f"<drake:mu_static>{_FRICTION}</drake:mu_static>"
        f"<drake:mu_dynamic>{_FRICTION}</drake:mu_dynamic></drake:proximity_properties>"
    )


def _box(
    name: str,
    p: tuple[float, float, float],
    size: tuple[float, float, float],
    color: str,
    properties: str,
) -> str:
    pose = f"<pose>{_text(p)} 0 0 0</pose>"
    geometry = f"<geometry><box><size>{_text(size)}</size></box></geometry>"
    return (
        f'<visual name="{name}">{pose}{geometry}'
        f"<material><diffuse>{color} 1</diffuse></material></visual>"
        f'<collision name="collision_{name}">{pose}{geometry}{properties}</collision>'
    )


def _cylinder(name: str, radius: float, length: float, color: str) -> str:
    return (
        f'<visual name="{name}"><pose>0 0 0 1.5707963 0 0</pose><geometry><cylinder>'
        f"<radius>{radius}</radius><length>{length:.6g}</length></cylinder></geometry>"
        f"<material><diffuse>{color} 1</diffuse></material></visual>"
    )


def _text(numbers_: tuple[float, float, float]) -> str:
    return " ".join(f"{value:.6g}" for value in numbers_)
