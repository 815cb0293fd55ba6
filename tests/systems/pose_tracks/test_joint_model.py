"""Models of estimated joints open in Drake and move as the joint was seen to."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

from crossmodal import joints
from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.systems.pose_tracks.joint_estimate import JointEstimate

TIMES = np.arange(90) / 15.0
START = se3.exp(np.array([0.4, -0.3, 0.5, 0.5, 0.1, 0.4]))
SCREWS = {
    "prismatic": (np.array([0.0, 0.0, 0.0, 0.6, 0.0, 0.8]), 0.3),
    "revolute": (np.array([0.0, 0.6, 0.8, 0.4, -0.1, 0.2]), 1.2),
    "screw": (np.array([0.0, 0.0, 1.0, 0.4, 0.0, 0.03]), 3.0),
    "rigid": (np.zeros(6), 0.0),
}


def _found(kind: str) -> JointEstimate:
    S, largest = SCREWS[kind]
    if kind == "revolute":
        S = np.concatenate([S[:3], np.cross([0.3, 0.2, 0.1], S[:3])])
    noise = np.random.default_rng(1).standard_normal((len(TIMES), 6)) * np.repeat([3e-3, 1e-3], 3)
    q = 0.5 * largest * (1.0 - np.cos(TIMES))
    found = joints.estimate(
        TIMES,
        np.array([se3.exp(S * a) @ START @ se3.exp(e) for a, e in zip(q, noise, strict=True)]),
    )
    assert found.type == kind
    return found


def _tracked(text: str, kind: str, q: float) -> Array:
    plant = MultibodyPlant(time_step=1e-3)
    Parser(plant).AddModelsFromString(text, kind)
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("parent"))
    plant.Finalize()
    context = plant.CreateDefaultContext()
    if plant.num_positions():
        plant.SetPositions(context, [q])
    frame = plant.GetFrameByName("tracked")
    return np.asarray(frame.CalcPoseInWorld(context).GetAsMatrix4())


@pytest.mark.parametrize("form", ["urdf", "sdf"])
@pytest.mark.parametrize("kind", SCREWS)
def test_a_model_moves_its_body_along_the_estimated_path(kind: str, form: str) -> None:
    found = _found(kind)
    if (kind, form) == ("screw", "urdf"):
        with pytest.raises(ValueError, match="URDF has no screw joints"):
            joints.to_urdf(found)
        return
    text = {"urdf": joints.to_urdf, "sdf": joints.to_sdf}[form](found)
    for q in (0.0, 0.7 * SCREWS[kind][1]):
        expected = found.pose(q) if found.moves else found.X_PB_zero
        assert_allclose(_tracked(text, form, q), expected, atol=1e-6)
    assert f"{kind}, probability" in text


def test_names_and_bodies_without_a_joint_are_refused() -> None:
    with pytest.raises(ValueError, match="no name of a model"):
        joints.to_sdf(_found("prismatic"), "my model")
    steps = np.random.default_rng(6).standard_normal((90, 6)) * 0.05
    free = [START]
    for step in steps[1:]:
        free.append(free[-1] @ se3.exp(step))
    loose = joints.estimate(TIMES, np.array(free), np.array([0.01, 0.003]))
    with pytest.raises(ValueError, match="disconnected"):
        joints.to_urdf(loose)
