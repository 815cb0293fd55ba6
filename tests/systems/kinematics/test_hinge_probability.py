"""Whether what turns is a hinge, or a screw that climbs next to nothing."""

import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.robustness_streams import Case, all_cases, simulate_case
from crossmodal.systems.kinematics.joint_filters import JointFilters, JointFiltersConfig
from crossmodal.systems.kinematics.measurement_errors import MeasurementErrorsConfig
from crossmodal.systems.port_values import JointBelief, JointModelBelief, JointType

DOOR = next(case for case in all_cases() if case.name == "door")


def _belief(revolute: float, screw: float, pitch: float, deviation: float) -> JointBelief:
    models = {kind: JointModelBelief(log_evidence=0.0) for kind in JointType}
    models[JointType.SCREW] = JointModelBelief(
        log_evidence=0.0, pitch_mixture=np.array([[1.0, pitch, deviation**2]])
    )
    probabilities = dict.fromkeys(JointType, 0.0)
    probabilities |= {JointType.REVOLUTE: revolute, JointType.SCREW: screw}
    probabilities[JointType.DISCONNECTED] = 1.0 - revolute - screw
    return JointBelief(
        parent_id=0, child_id=1, probabilities=probabilities, models=models, updates=1
    )


def test_flat_screws_count_as_hinges() -> None:
    belief = _belief(0.5, 0.4, 2e-3, 1e-3)
    assert belief.hinge_probability(2e-3) == pytest.approx(0.5 + 0.4 * 0.5, abs=1e-4)
    assert belief.hinge_probability(1.0) == pytest.approx(0.9)
    assert belief.hinge_probability(0.0) == pytest.approx(0.5)
    assert _belief(0.5, 0.4, 2e-3, 0.0).hinge_probability(1e-3) == pytest.approx(0.5)
    assert _belief(0.7, 0.3, math.nan, math.nan).hinge_probability() == 0.7


def test_how_far_it_may_be_from_a_hinge() -> None:
    belief = _belief(0.5, 0.4, 2e-3, 1e-3)
    climb = belief.hinge_climb(0.7)
    assert climb == pytest.approx(2e-3, abs=1e-5)
    assert belief.hinge_probability(climb) == pytest.approx(0.7, abs=1e-6)
    assert belief.hinge_climb(0.5) < 1e-9
    assert belief.hinge_climb(0.95) == math.inf


@pytest.mark.parametrize(("pitch", "is_door"), [(0.0, True), (0.02, False)])
def test_a_door_that_is_seen_to_open_is_said_to_be_one(pitch: float, is_door: bool) -> None:
    """Through 60 deg to 3 mm and 1 deg; its type alone stays below .8."""
    case: Case = replace(
        DOOR,
        joint="screw" if pitch > 0.0 else "revolute",
        pitch=pitch,
        duration=10.0,
        motion=lambda t: np.deg2rad(60.0) * t / 10.0,
    )
    # By a drift of the tracker's rotation along with the motion a door might climb, too.
    for wander, certain in ((0.5, 0.5), (0.0, 0.1)):
        errors = MeasurementErrorsConfig(wander=wander)
        filters = JointFilters(JointFiltersConfig(errors=errors))
        for seed in range(3):
            stream = simulate_case(case, seed)
            state = filters.start(stream.X_PB_measured[0], case.covariance, 0.0)
            for t, X in zip(stream.times[1:], stream.X_PB_measured[1:], strict=True):
                state = filters.update(state, X, case.covariance, float(t))
            probability = filters.belief(state).hinge_probability()
            assert (probability > 0.9) == is_door
            assert (probability < certain) != is_door


def test_positions_alone_say_of_the_pitch_what_was_known_before() -> None:
    """Which is that most screws are flat, and that it may be a steep one."""
    filters, stream = JointFilters(JointFiltersConfig()), simulate_case(DOOR, 0)
    covariance = DOOR.covariance.copy()
    covariance[:3], covariance[:, :3] = 0.0, 0.0
    covariance[:3, :3] = np.diag(np.full(3, np.inf))
    state = filters.start(stream.X_PB_measured[0], covariance, 0.0)
    for t, X in zip(stream.times[1:], stream.X_PB_measured[1:], strict=True):
        state = filters.update(state, X, covariance, float(t))
    belief = filters.belief(state)
    flat = 4 / 7 + 2 / 7 * math.erf(0.5 / math.sqrt(2.0)) + 1 / 7 * math.erf(0.05 / math.sqrt(2.0))
    expected = (
        belief.probabilities[JointType.REVOLUTE] + belief.probabilities[JointType.SCREW] * flat
    )
    assert belief.hinge_probability() == pytest.approx(expected, abs=1e-3)
    assert 0.85 < belief.hinge_probability() < 0.9
    assert belief.models[JointType.SCREW].pitch_variance == pytest.approx(
        4 / 7 * 1e-6 + 2 / 7 * 1e-4 + 1 / 7 * 1e-2, rel=0.02
    )
