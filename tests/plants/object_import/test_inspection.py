"""What is found in a model before anything of it is chosen."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake.math import RollPitchYaw
from wild_models import write_cabinet

from crossmodal.models import MODELS_DIR
from crossmodal.plants.hands.soft_hand import SOFT_HAND_RANGE as CAN
from crossmodal.plants.object_import.inspection import inspect_model
from crossmodal.plants.object_import.object_import import import_object

EXAMPLE = MODELS_DIR / "examples" / "two_drawers.urdf"
BARE = """<robot name='m'><link name='case'><visual><origin xyz='-0.2 0 0'/><geometry>
<box size='0.4 0.5 0.3'/></geometry></visual></link><link name='front'><visual>
<origin xyz='0.01 0 0'/><geometry><box size='0.02 0.5 0.3'/></geometry></visual><visual>
<origin xyz='0.09 0.05 0.02' rpy='1.5707963 0 0'/><geometry><cylinder radius='0.009' length='0.17'/>
</geometry></visual></link><joint name='slide' type='prismatic'><parent link='case'/>
<child link='front'/><axis xyz='1 0 0'/><limit lower='0' upper='0.3'/></joint></robot>"""


def test_links_joints_and_frames_are_found_with_their_sizes_and_limits(tmp_path: Path) -> None:
    found = inspect_model(write_cabinet(tmp_path))
    joints = {joint.name: joint for joint in found.joints}
    assert (joints["upper"].kind, joints["upper"].child) == ("prismatic", "cabinet.upper")
    assert (joints["upper"].lower, joints["upper"].upper) == (0.0, 0.35)
    assert joints["standing"].kind == "fixed"
    links = {link.name: link for link in found.links}
    assert_allclose(links["tray"].size, [0.1, 0.1, 0.02], atol=1e-6)
    assert {handle.grasp_frame for handle in found.handles} >= {"upper_grip", "lower_grip"}


def test_the_frames_of_a_models_handles_are_found_with_their_bars() -> None:
    found = inspect_model(EXAMPLE)
    assert [(x.grasp_frame, x.joint) for x in found.handles] == [
        ("left_handle", "left_slide"),
        ("right_handle", "right_slide"),
    ]
    assert all(np.allclose(handle.bar.thickness, 0.018) for handle in found.handles)
    assert np.isnan(found.links[0].mass)


@pytest.mark.parametrize("scale", [1.0, 0.5])
def test_a_bar_without_a_frame_is_found_and_can_be_grasped(scale: float, tmp_path: Path) -> None:
    path = tmp_path / "bare.urdf"
    path.write_text(BARE)
    (handle,) = inspect_model(path, scale=scale).handles
    assert handle.joint == "slide"
    assert_allclose(handle.length, 0.17 * scale, rtol=0.01)
    assert_allclose(handle.bar.clearance, 0.061 * scale, atol=0.002)
    link, _, pose = handle.grasp_frame.partition("@")
    assert link == "front"
    at = np.array([float(value) for value in pose.split(",")])
    # Only the fingers' tips are behind a bar that is near the board.
    out = max(0.0, CAN.tips - (handle.bar.clearance + 0.009 * scale))
    assert_allclose(at[:3], np.array([0.09, 0.05, 0.02]) * scale + [out, 0, 0], atol=1e-3)
    assert import_object(path, tmp_path / "out", grasp_frame=handle.grasp_frame, scale=scale)


LID = """<robot name='m'><link name='case'><visual><geometry><box size='0.02 0.4 0.2'/>
</geometry></visual></link><link name='lid'><visual><origin xyz='0.2 0 0.11'/><geometry>
<box size='0.36 0.4 0.02'/></geometry></visual></link><joint name='hinge' type='revolute'>
<parent link='case'/><child link='lid'/><axis xyz='0 -1 0'/><limit lower='0' upper='1.5'
effort='0' velocity='1'/></joint></robot>"""


def test_the_free_edge_of_a_board_without_a_handle_is_one(tmp_path: Path) -> None:
    path = tmp_path / "lid.urdf"
    path.write_text(LID)
    (handle,) = inspect_model(path).handles
    assert (handle.joint, handle.faults) == ("hinge", [])
    assert handle.grasp_frame == "lid@0.36,0,0.11,0,0,0"
    assert import_object(path, tmp_path / "out", grasp_frame=handle.grasp_frame)
    # Fingers do not fit between a lid and what it lies on.
    path.write_text(LID.replace("size='0.02 0.4", "size='0.9 0.4"))
    assert inspect_model(path).handles == []


LEVER = """<robot name='m'><link name='door'><visual><geometry><box size='0.04 0.8 1'/></geometry>
</visual></link><link name='lever'><visual><origin xyz='0.08 0.07 0' rpy='1.5708 0 0'/><geometry>
<cylinder radius='0.009' length='0.16'/></geometry></visual><visual><origin xyz='0.05 0 0'
rpy='0 1.5708 0'/><geometry><cylinder radius='0.009' length='0.06'/></geometry></visual></link>
<joint name='latch' type='revolute'><parent link='door'/><child link='lever'/><axis xyz='1 0 0'/>
<limit lower='-1' upper='0' effort='0' velocity='1'/></joint></robot>"""


def test_a_lever_is_grasped_from_the_side_of_the_hand(tmp_path: Path) -> None:
    path = tmp_path / "door.urdf"
    path.write_text(LEVER)
    (handle,) = inspect_model(path).handles
    angles = np.array(handle.grasp_frame.split(",")[3:], float)
    R_LH = RollPitchYaw(angles).ToRotationMatrix().matrix()
    assert_allclose(R_LH[:, 0], [1, 0, 0], atol=0.1)


@pytest.mark.parametrize(("axis", "fault"), [("0 0 1", []), ("1 0 0", ["it turns in place"])])
def test_a_knob_is_held_where_it_does_not_turn_in_place(
    axis: str, fault: list[str], tmp_path: Path
) -> None:
    path = tmp_path / "door.urdf"
    knob = (
        "<origin xyz='0.06 0 0'/><geometry><sphere radius='0.014'/></geometry></visual></link>"
        "<joint name='latch' type='revolute'>"
    )
    start, end = LEVER.partition("<origin xyz='0.08")[0], LEVER.partition("type='revolute'>")[2]
    text = f"{start}{knob}<origin xyz='0 {0.3 if axis == '0 0 1' else 0} 0'/>{end}"
    path.write_text(text.replace("'1 0 0'", f"'{axis}'"))
    (handle,) = inspect_model(path).handles
    assert handle.faults == fault


def test_the_handle_of_a_screw_is_found() -> None:
    (handle,) = inspect_model(MODELS_DIR / "sdf" / "fly_press.sdf").handles
    assert (handle.grasp_frame, handle.joint, handle.faults) == ("handle", "spindle", [])


def test_a_model_that_is_none_is_refused_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no such file"):
        inspect_model(tmp_path / "none.sdf")


@pytest.mark.parametrize(("travel", "faults"), [(0.4, 0), (0.012, 1)])
def test_a_button_is_no_handle(travel: float, faults: int, tmp_path: Path) -> None:
    path = tmp_path / "button.urdf"
    box = "<visual><origin xyz='{} 0 0'/><geometry><box size='{}'/></geometry></visual>"
    path.write_text(
        f"<robot name='m'><link name='body'>{box.format(-0.2, '0.2 0.5 0.5')}</link>"
        f"<link name='bar'>{box.format(0, '0.02 0.2 0.02')}</link>"
        "<joint name='j' type='prismatic'><parent link='body'/><child link='bar'/>"
        f"<axis xyz='1 0 0'/><limit lower='0' upper='{travel}'/></joint></robot>"
    )
    (handle,) = inspect_model(path).handles
    assert len(handle.faults) == faults
    assert all("it goes 12 mm" in fault for fault in handle.faults)
