"""The pose of an object that is sought leaves as a frame and with its covariance."""

from typing import Any

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.analysis import Simulator

from crossmodal.diagrams.applications import load_scenario
from crossmodal.diagrams.run.calibration import Calibration
from crossmodal.diagrams.run.stream.estimate_stream import EstimateStream
from crossmodal.maths import se3
from crossmodal.systems.port_values import UNKNOWN_POSE, ObjectPose


class Kept:
    """Keeps what a sink is given."""

    place = ""

    def __init__(self) -> None:
        self.messages: dict[str, Any] = {}

    def write(self, topic: str, message: Any, now: int) -> None:
        self.messages[topic] = message

    def close(self) -> None:
        pass


def streamed(belief: ObjectPose) -> dict[str, Any]:
    application, scenario = load_scenario("touches")
    sink, quantities = Kept(), application.quantities(scenario)
    stream = EstimateStream(sink, application, scenario, Calibration(), quantities, ["density"], {})
    simulator = Simulator(stream)
    port = stream.GetInputPort("density_object_pose_latest")
    port.FixValue(simulator.get_mutable_context(), AbstractValue.Make(belief))
    simulator.AdvanceTo(scenario.network_period)
    return sink.messages


def test_nothing_is_sent_of_a_pose_that_is_unknown() -> None:
    assert streamed(UNKNOWN_POSE) == {}


def test_a_pose_is_that_of_the_mesh_with_the_covariance_of_its_samples() -> None:
    rng = np.random.default_rng(0)
    middle = np.array([0.1, -0.2, 0.3])
    X_WM = se3.exp(np.array([0.3, -0.5, 0.9, 0.4, 0.5, 0.6]))
    root = 1e-4 * rng.normal(size=(6, 6))
    covariance = root @ root.T
    belief = ObjectPose(
        X=X_WM,
        covariance=covariance,
        joint=covariance,
        samples=np.zeros((0, 4, 4)),
        calibration=np.zeros((0, 0)),
        modes=X_WM[None],
        probabilities=np.ones(1),
        middle=middle,
    )
    sent = streamed(belief)
    frame = sent["/tf"].transforms[0]
    assert (frame.header.frame_id, frame.child_frame_id) == ("world", "density/object_pose")
    pose = sent["/density/object_pose"].pose
    position = pose.pose.position
    np.testing.assert_allclose([position.x, position.y, position.z], belief.X_WO[:3, 3])
    steps = []
    for e in rng.multivariate_normal(np.zeros(6), covariance, size=4000):
        X = X_WM.copy()
        X[:3, :3] = X_WM[:3, :3] @ se3.so3_exp(e[:3])
        X[:3, 3] += e[3:]
        turn = se3.log(np.block([[X[:3, :3] @ X_WM[:3, :3].T, np.zeros((3, 1))], [0, 0, 0, 1]]))
        moved = X[:3, 3] - X[:3, :3] @ middle - belief.X_WO[:3, 3]
        steps.append(np.concatenate([moved, turn[:3]]))
    scale = np.sqrt(np.diag(np.cov(np.array(steps).T)))
    expected = np.cov(np.array(steps).T) / np.outer(scale, scale)
    np.testing.assert_allclose(
        pose.covariance.reshape(6, 6) / np.outer(scale, scale), expected, atol=0.1
    )
