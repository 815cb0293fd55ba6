"""What a model alone says about its joint and its handle."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from crossmodal.diagrams.crossmodal.objects.object_model import ObjectModel, read_object_model
from crossmodal.models import SDF_DIR
from crossmodal.systems.port_values import JointType


def facts(model: str, joint: str) -> ObjectModel:
    return read_object_model(SDF_DIR / model, joint=joint, frame="handle", source="")


def test_a_screw_is_an_angle_whose_lever_is_measured_across_its_axis() -> None:
    """The handle goes along x of its frame, and by 8 cm a turn downwards, where z of it points."""
    press = facts("fly_press.sdf", "spindle")
    assert press.joint_type == JointType.SCREW
    assert press.unit == "rad"
    assert_allclose(press.lever, 0.22)
    pitch = 0.08 / (2.0 * np.pi)
    assert_allclose(press.way_H, np.array([0.22, 0.0, pitch]) / np.hypot(0.22, pitch), atol=1e-5)
    assert press.two_ways
    assert press.lower == -np.inf
    assert press.upper == np.inf


@pytest.mark.parametrize(
    ("model", "joint", "lever", "way_H"),
    [
        ("tripod.sdf", "pan", 0.22, [1.0, 0.0, 0.0]),
        ("chest_drawer.sdf", "slide", 0.0, [1.0, 0.0, 0.0]),
        ("cupboard_door.sdf", "hinge", np.hypot(0.345, 0.079), np.array([0.345, 0.079, 0.0])),
    ],
)
def test_lever_and_way_are_those_of_the_drawing(
    model: str, joint: str, lever: float, way_H: list[float]
) -> None:
    """The handle is .345 m beside the hinge of the door and .079 m in front of it."""
    found = facts(model, joint)
    assert_allclose(found.lever, lever, atol=1e-9)
    assert_allclose(found.way_H, way_H / np.linalg.norm(way_H), atol=1e-5)
