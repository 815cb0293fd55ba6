"""Feature and rigid-body motion together, on a rendered drawer with a camera's noise."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from pydrake.systems.framework import Diagram, DiagramBuilder

from crossmodal.maths import se3
from crossmodal.maths.pinhole import Intrinsics
from crossmodal.systems.port_values import BodyMotion
from crossmodal.systems.vision.bodies.rigid_body_motion import RigidBodyMotion
from crossmodal.systems.vision.bodies.rigid_body_motion_config import RigidBodyMotionConfig
from crossmodal.systems.vision.features.feature_motion import FeatureMotion
from crossmodal.systems.vision.features.feature_motion_config import FeatureMotionConfig

NEES_BOUND = 22.46  # Chi-square of 6 dof that 0.1 % exceed.


@pytest.fixture
def network(camera: Intrinsics, drawer_sequence: Any) -> Diagram:
    builder = DiagramBuilder()
    X_WC = drawer_sequence.X_WC
    features = builder.AddSystem(FeatureMotion(FeatureMotionConfig(), camera))
    bodies = builder.AddSystem(RigidBodyMotion(RigidBodyMotionConfig(), camera, X_WC))
    builder.Connect(
        features.GetOutputPort("features_estimated"), bodies.GetInputPort("features_estimated")
    )
    builder.Connect(
        bodies.GetOutputPort("features_predicted"), features.GetInputPort("features_predicted")
    )
    for port in ("color_measured", "depth_measured", "robot_mask"):
        builder.ExportInput(features.GetInputPort(port), port)
    builder.ExportOutput(features.GetOutputPort("features_latest"), "features")
    builder.ExportOutput(bodies.GetOutputPort("body_motions_latest"), "bodies")
    return builder.Build()


def error_and_nees(body: BodyMotion, X_WD_start: np.ndarray, X_WD: np.ndarray) -> tuple:
    """Displacement error (6,) since the reference, in B, and its squared Mahalanobis length."""
    X_WB = X_WD @ np.linalg.inv(X_WD_start) @ body.X_WB_reference
    error = se3.log(se3.inverse(body.motion.X) @ X_WB)
    return error, error @ np.linalg.solve(body.motion.covariance[:6, :6], error)


@pytest.mark.parametrize("seed", [0, 1])
def test_a_drawer_is_followed_over_22_cm_to_within_its_own_uncertainty(
    network: Diagram, drawer_sequence: Any, tick: Callable, seed: int
) -> None:
    born, inside, error = None, [], np.full(6, np.nan)
    for k, context in tick(network, lambda k: drawer_sequence.measured(k, seed), 115):
        bodies = network.GetOutputPort("bodies").Eval(context).bodies
        assert len(bodies) <= 1
        if bodies:
            born = k if born is None else born
            error, nees = error_and_nees(
                bodies[0], drawer_sequence.X_WD[0], drawer_sequence.X_WD[k]
            )
            inside.append(nees < NEES_BOUND)
    assert born is not None
    assert 20 < born < 35
    assert np.linalg.norm(error[3:]) < 1e-3
    assert np.mean(inside) > 0.9


def test_features_survive_a_jump_of_the_exposure(
    network: Diagram, drawer_sequence: Any, tick: Callable
) -> None:
    def measured(k: int) -> dict[str, Any]:
        # From normal to nearly white within three ticks, and back within four.
        gain = np.interp(k, [50, 53, 56, 60], [1.0, 4.0, 4.0, 1.3])
        return drawer_sequence.measured(k, 2, gain=float(gain))

    ids_before, seen = np.zeros(0), []
    for k, context in tick(network, measured, 75):
        features = network.GetOutputPort("features").Eval(context)
        seen.append(len(features.ids))
        if k == 49:
            ids_before = features.ids
    assert min(seen[53:57]) < 0.2 * seen[49]
    kept = np.isin(ids_before, features.ids)
    assert np.mean(kept) > 0.85
    body = network.GetOutputPort("bodies").Eval(context).bodies[0]
    error, nees = error_and_nees(body, drawer_sequence.X_WD[0], drawer_sequence.X_WD[74])
    assert np.linalg.norm(error[3:]) < 1e-3
    assert nees < NEES_BOUND


def test_nothing_is_seen_in_the_dark_and_the_body_is_given_up(
    network: Diagram, drawer_sequence: Any, tick: Callable
) -> None:
    def measured(k: int) -> dict[str, Any]:
        dark = k >= 45
        return drawer_sequence.measured(
            k, 3, gain=0.0 if dark else 1.0, read_noise=6.0 if dark else 2.0
        )

    sigmas = {}
    for k, context in tick(network, measured, 85):
        features = network.GetOutputPort("features").Eval(context)
        bodies = network.GetOutputPort("bodies").Eval(context).bodies
        if k >= 45:
            assert len(features.ids) == 0
        if bodies:
            sigmas[k] = np.sqrt(np.trace(bodies[0].motion.covariance[3:6, 3:6]))
    assert max(sigmas) in range(60, 80)
    assert sigmas[44] < sigmas[50] < sigmas[60]
