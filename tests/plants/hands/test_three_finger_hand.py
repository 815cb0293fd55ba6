import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JacobianWrtVariable

from crossmodal.models import SDF_DIR
from crossmodal.plants.hands.three_finger_hand import JOINTS, closed_posture, grip_torques
from crossmodal.plants.parsing import add_model, make_parser

THICKNESS = 0.021
PAD = {"thumb": 0.010, "left": -0.010, "right": -0.010}  # x of the pad's surface in its link, [m].


@pytest.fixture(scope="module")
def hand() -> MultibodyPlant:
    plant = MultibodyPlant(0.0)
    model = add_model(make_parser(plant), SDF_DIR / "three_finger_hand.sdf", "hand")
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("palm", model))
    plant.Finalize()
    return plant


def test_the_joints_have_these_names_in_this_order(hand: MultibodyPlant) -> None:
    assert [hand.GetJointByName(name).position_start() for name in JOINTS] == list(range(6))


@pytest.mark.parametrize("finger", PAD)
def test_closed_fingers_lay_their_pads_on_the_bar(hand: MultibodyPlant, finger: str) -> None:
    context = hand.CreateDefaultContext()
    hand.SetPositions(context, closed_posture(THICKNESS))
    body, end_effector = hand.GetBodyByName(f"{finger}_2"), hand.GetFrameByName("end_effector")
    X_EB = body.body_frame().CalcPose(context, end_effector)
    assert_allclose(X_EB.rotation().matrix(), np.eye(3), atol=1e-9)
    side = -np.sign(PAD[finger])
    surface = X_EB @ np.array([np.sign(PAD[finger]) * 0.013, 0.0, 0.025])
    assert_allclose(surface[0], side * 0.5 * THICKNESS, atol=1e-6)


def test_the_grip_s_torques_press_with_the_force_and_balance(hand: MultibodyPlant) -> None:
    context = hand.CreateDefaultContext()
    hand.SetPositions(context, closed_posture(THICKNESS))
    torques, world = np.zeros(6), hand.world_frame()
    for finger, force in (("thumb", 60.0), ("left", -30.0), ("right", -30.0)):
        frame = hand.GetBodyByName(f"{finger}_2").body_frame()
        J = hand.CalcJacobianTranslationalVelocity(
            context, JacobianWrtVariable.kV, frame, np.array([0.0, 0.0, 0.025]), world, world
        )
        torques += J.T @ np.array([force, 0.0, 0.0])
    assert_allclose(grip_torques(THICKNESS, 60.0), torques, rtol=1e-6)


def test_a_bar_that_does_not_fit_is_refused() -> None:
    with pytest.raises(ValueError, match="does not close around a bar of 70 mm"):
        closed_posture(0.07)
