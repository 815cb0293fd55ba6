"""What is said of an object before it runs: bars that the hand does not hold, turned looks."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose
from trimesh.transformations import rotation_matrix

from crossmodal.diagrams.applications import load_scenario
from crossmodal.diagrams.crossmodal.objects.grasp_checks import grasp_faults, model_warnings
from crossmodal.diagrams.crossmodal.scenario import object_model_file
from crossmodal.plants.hands.soft_hand import SOFT_HAND_RANGE
from crossmodal.plants.object_import.bars import bar_at


def bar(
    thickness: float = 0.018, clearance: float = 0.06, tilt: float = 0.0, merge: bool = False
) -> trimesh.Trimesh:
    """A bar along y with two posts in front of a panel."""
    half = 0.5 * thickness
    parts = [trimesh.creation.cylinder(half, 0.17, sections=24)]
    parts[0].apply_transform(rotation_matrix(np.pi / 2, [1, 0, 0]))
    for y in (-0.078, 0.078):
        post = trimesh.creation.box([clearance + half, 0.01, 0.01])
        post.apply_translation([-0.5 * (clearance + half), y, 0])
        parts.append(post)
    panel = trimesh.creation.box([0.02, 0.4, 0.4])
    panel.apply_translation([-half - clearance - 0.01, 0, 0])
    solid = trimesh.util.concatenate([*parts, panel])
    if merge:
        solid.merge_vertices()
    solid.apply_transform(rotation_matrix(tilt, [1, 0, 0]))
    return solid


@pytest.mark.parametrize("merge", [False, True])
@pytest.mark.parametrize("thickness", [0.008, 0.018, 0.04])
@pytest.mark.parametrize("clearance", [0.01, 0.05])
def test_a_bars_thickness_and_clearance_are_found(
    thickness: float, clearance: float, merge: bool
) -> None:
    found = bar_at(bar(thickness, clearance, merge=merge), 0.03)
    assert found is not None
    assert_allclose(found.thickness, thickness, rtol=0.05)
    assert_allclose(found.clearance, clearance, atol=0.002)
    assert found.distance == 0.0
    assert found.tilt < 0.01


def test_a_bar_is_found_beside_a_panel_in_whose_bounds_the_frame_is() -> None:
    """As where a door goes slantwise out of the frame's x."""
    solid = bar(clearance=0.03).apply_transform(rotation_matrix(0.2, [0, 1, 0]))
    found = bar_at(solid.apply_translation([-0.02, 0, 0]), 0.03)
    assert found is not None
    assert_allclose(found.thickness, 0.018, rtol=0.05)


@pytest.mark.parametrize(("stem", "clearance"), [(0.012, 0.03), (0.04, 0.0)])
def test_fingers_close_on_both_sides_of_a_stem_that_is_thinner(
    stem: float, clearance: float
) -> None:
    solid = [trimesh.creation.icosphere(3, 0.016), trimesh.creation.box([0.03, stem, stem])]
    solid += [trimesh.creation.box([0.02, 0.4, 0.4])]
    solid[1].apply_translation([-0.031, 0, 0])
    solid[2].apply_translation([-0.016 - 0.03 - 0.01, 0, 0])
    found = bar_at(trimesh.util.concatenate(solid), 0.03)
    assert found is not None
    assert_allclose(found.thickness, 0.032, rtol=0.05)
    assert_allclose(found.clearance, clearance, atol=0.003)


def test_what_stands_on_a_panel_has_nothing_free_behind_it() -> None:
    solid = [trimesh.creation.box([0.04, 0.02, 0.02]), trimesh.creation.box([0.02, 0.4, 0.4])]
    solid[1].apply_translation([-0.03, 0, 0])
    found = bar_at(trimesh.util.concatenate(solid), 0.03)
    assert found is not None
    assert found.clearance == pytest.approx(0.0, abs=1e-6)


def test_a_bars_tilt_is_found_and_leaves_its_thickness() -> None:
    found = bar_at(bar(tilt=0.4), 0.03)
    assert found is not None
    assert_allclose(found.tilt, 0.4, atol=0.02)
    assert_allclose(found.thickness, 0.018, rtol=0.1)


@pytest.mark.parametrize(
    ("solid", "expected"),
    [
        (bar(0.07), "it is 70 mm thick, it closes around 4 to 55 mm"),
        (bar(0.002), "it is 2.0 mm thin"),
        (bar(clearance=0.006), "6 mm are free behind it, the fingers need 10 mm"),
        (bar(clearance=0.012), "21 mm are between the frame and what is behind it, the fingers"),
        (bar(tilt=0.7), "it is 40 deg off the frame's y, and may be 25"),
        (bar(tilt=np.pi / 2), "thick"),
        (trimesh.creation.box([0.02, 0.4, 0.4]), "it is 400 mm thick"),
        (bar().apply_translation([-0.2, 0, 0]), "in thin air: no collision geometry"),
        (trimesh.Trimesh(), "in thin air: no collision geometry"),
    ],
)
def test_a_bar_that_the_hand_does_not_hold_is_warned_of(
    solid: trimesh.Trimesh, expected: str
) -> None:
    faults = grasp_faults(solid, "grip", SOFT_HAND_RANGE)
    assert len(faults) == 1
    assert expected in faults[0]
    assert "'grip'" in faults[0]


def test_an_edge_is_held_where_fingers_go_to_both_of_its_sides() -> None:
    board = trimesh.creation.box([0.3, 0.4, 0.02]).apply_translation([-0.13, 0, 0])
    assert grasp_faults(board, "grip", SOFT_HAND_RANGE) == []
    (fault,) = grasp_faults(board.copy().apply_translation([0.03, 0, 0]), "grip", SOFT_HAND_RANGE)
    assert "300 mm thick" in fault
    case = trimesh.creation.box([0.3, 0.4, 0.1]).apply_translation([-0.13, 0, 0.08])
    (fault,) = grasp_faults(board + case, "grip", SOFT_HAND_RANGE)
    assert "30 mm are free beside the edge's middle, the fingers need 55 mm" in fault


def test_of_the_programs_own_handles_nothing_is_said() -> None:
    # The edge of the box's lid has the lid behind it, and is held by its rounded rim.
    for name in ("drawer", "cupboard-door", "glass-door", "sliding-door", "tripod", "press"):
        thing = load_scenario(name)[1].object
        assert model_warnings(object_model_file(thing), thing.handle_frame, "") == []


@pytest.mark.parametrize(("size", "expected"), [("0.3 0.02 0.2", 1), ("0.3 0.2 0.02", 0)])
def test_looks_that_are_turned_against_the_touch_are_warned_of(
    size: str, expected: int, tmp_path: Path
) -> None:
    path = tmp_path / "m.sdf"
    path.write_text(
        "<sdf version='1.9'><model name='m'><link name='b'><visual name='v'><pose>0 0 0.1 0 0 0"
        f"</pose><geometry><box><size>{size}</size></box></geometry></visual><collision name='c'>"
        "<pose>0 0 0.1 0 0 0</pose><geometry><box><size>0.3 0.2 0.02</size></box></geometry>"
        "</collision></link><frame name='f' attached_to='b'/></model></sdf>"
    )
    lines = [line for line in model_warnings(path, "f", "") if "turned by 90 deg" in line]
    assert len(lines) == expected
