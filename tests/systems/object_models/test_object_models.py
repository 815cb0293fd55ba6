"""An articulated object opens in Drake as it was written, and moves as it was perceived."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

from crossmodal.maths import se3
from crossmodal.systems.object_models.articulated_object import (
    ArticulatedObject,
    ObjectBody,
    ObjectJoint,
)
from crossmodal.systems.object_models.model_text import as_name
from crossmodal.systems.object_models.sdf import sdf
from crossmodal.systems.object_models.urdf import urdf

WRITERS = {"sdf": sdf, "urdf": urdf}
X_WBOX = se3.exp(np.array([0.3, -0.2, 0.9, 0.6, 0.1, 0.4]))  # The box where it slides from.
X_BOX_LID = se3.exp(np.array([0.1, 0.5, -0.4, 0.0, 0.2, 0.1]))


def _box_with_lid() -> ArticulatedObject:
    """A box that slides, and its lid."""
    axis, point = np.array([0.0, 0.6, 0.8]), np.array([0.05, 0.1, -0.1])
    slide = ObjectJoint(
        name="slide",
        parent="environment",
        child="box",
        type="prismatic",
        S_P=np.array([0.0, 0.0, 0.0, 0.6, 0.0, 0.8]),
        X_PB_zero=X_WBOX,
        lower=-0.1,
        upper=0.3,
        upper_is_stop=True,
        upper_deviation=0.004,
        friction=5.0,
        friction_deviation=0.7,
        damping=-1.0,
        damping_deviation=4.0,
        axis_deviation=0.01,
        probability=0.98,
    )
    hinge = ObjectJoint(
        name="hinge",
        parent="box",
        child="lid",
        type="revolute",
        S_P=np.concatenate([axis, np.cross(point, axis)]),
        X_PB_zero=X_BOX_LID,
        lower=0.0,
        upper=1.0,
        axis_deviation=0.02,
        position_deviation=0.003,
    )
    box = ObjectBody(name="box", frame="box_frame", low=-np.full(3, 0.1), high=np.full(3, 0.2))
    lid = ObjectBody(name="lid", frame="lid_frame", low=np.zeros(3), high=np.array([0.1, 0.1, 0.0]))
    return ArticulatedObject(root="environment", bodies=[box, lid], joints=[slide, hinge])


def _opened(text: str, form: str) -> MultibodyPlant:
    plant = MultibodyPlant(time_step=1e-3)
    Parser(plant).AddModelsFromString(text, form)
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("environment"))
    plant.Finalize()
    return plant


@pytest.mark.parametrize("form", WRITERS)
def test_a_body_on_a_moving_parent_goes_where_both_joints_put_it(form: str) -> None:
    found = _box_with_lid()
    plant = _opened(WRITERS[form](found, "box"), form)
    context = plant.CreateDefaultContext()
    for q, theta in ((0.0, 0.0), (0.2, 0.7), (-0.1, -0.3)):
        for name, value in (("slide", q), ("hinge", theta)):
            joint = plant.GetJointByName(name)
            positions = plant.GetPositions(context)
            positions[joint.position_start()] = value
            plant.SetPositions(context, positions)
        X_WBox = found.joints[0].pose(q)
        for frame, X in (
            ("box_frame", X_WBox),
            ("lid_frame", X_WBox @ found.joints[1].pose(theta)),
        ):
            X_WB = plant.GetFrameByName(frame).CalcPoseInWorld(context).GetAsMatrix4()
            assert_allclose(X_WB, X, atol=1e-7)


@pytest.mark.parametrize("form", WRITERS)
def test_limits_and_damping_are_there_and_uncertainty_is_told(form: str) -> None:
    text = WRITERS[form](_box_with_lid(), "box")
    slide = _opened(text, form).GetJointByName("slide")
    assert_allclose([slide.position_lower_limits(), slide.position_upper_limits()], [[-0.1], [0.3]])
    assert slide.default_damping_vector()[0] == 0.0  # It was perceived below zero.
    for line in (
        "slide: prismatic, probability 0.980",
        "lower limit -0.1 m is what was seen",
        "upper limit 0.3 +- 0.004 m is an end stop",
        "friction 5 +- 0.7 N",
        "damping -1 +- 4 N s/m",
        "hinge: revolute",
        "position of the axis known to 3 mm",
    ):
        assert f"<!-- {line} -->" in text


@pytest.mark.parametrize("form", WRITERS)
def test_a_shape_is_the_box_that_was_perceived(form: str) -> None:
    text = WRITERS[form](_box_with_lid(), "box")
    assert text.count("_collision") == 2
    assert "0.3 0.3 0.3" in text
    assert "0.1 0.1 0.005" in text  # A face has no thickness of its own.
    shapeless = _box_with_lid()
    shapeless.bodies[0].low = np.full(3, np.nan)
    assert WRITERS[form](shapeless, "box").count("_collision") == 1


def test_what_cannot_be_written_is_refused() -> None:
    with pytest.raises(ValueError, match="no joint was perceived"):
        sdf(ArticulatedObject(root="environment"), "box")
    screw = _box_with_lid()
    screw.joints[1].type = "screw"
    with pytest.raises(ValueError, match="URDF has no screw joints"):
        urdf(screw, "box")
    lost = _box_with_lid()
    lost.joints[0].parent = "table"
    with pytest.raises(ValueError, match="'slide' has the parent 'table', which is no body"):
        sdf(lost, "box")


def test_any_text_becomes_a_name() -> None:
    assert as_name("my door (2)") == "my_door__2_"
    assert as_name("2nd") == "object_2nd"
