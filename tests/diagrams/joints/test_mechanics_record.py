"""What moving a joint takes, as rows, summary, line and plot."""

import json
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake.multibody.plant import MultibodyPlant
from synthetic_episode import synthetic_episode, without_truth

from crossmodal.diagrams.crossmodal.application import APPLICATION
from crossmodal.diagrams.crossmodal.results.plots import draw_mechanics
from crossmodal.diagrams.crossmodal.results.results import evaluate
from crossmodal.diagrams.evaluation.metric_table import tidy_metrics
from crossmodal.diagrams.evaluation.run_writer import summarise
from crossmodal.diagrams.joints.joint_metrics import joint_episode, joints_of
from crossmodal.diagrams.joints.joint_truth import JointMechanicsTruth, joint_mechanics
from crossmodal.diagrams.joints.mechanics_record import mechanics_line
from crossmodal.diagrams.run.record import EpisodeRecord
from crossmodal.models import SDF_DIR
from crossmodal.plants.parsing import make_parser
from crossmodal.systems.port_values import (
    HELD_BODY,
    DetentBelief,
    JointBeliefs,
    JointMechanics,
    JointMechanicsBelief,
    JointMechanicsBeliefs,
    JointType,
    LimitBelief,
)

START = 0.001  # Of the synthetic drawer, [m].


def limit(probability: float, position: float, bound: float) -> LimitBelief:
    return LimitBelief(
        probability=probability,
        position=position,
        variance=0.002**2,
        bound=bound,
        bound_variance=0.001**2,
    )


def felt_episode(joint_type: JointType = JointType.PRISMATIC) -> EpisodeRecord:
    """A drawer that was pulled to its stop and never pushed to its other one.

    `proprioception` believes in an axis against the true one: there lower is upper.
    """
    record = synthetic_episode(joint_type)
    for tick in record.station:
        tick.values["cheat_joint_mechanics"] = JointMechanicsTruth(
            friction=6.0, damping=8.0, lower=-0.05, upper=0.242, detent=9.2
        )
    for name in ("proprioception", "crossmodal"):
        sign = -1.0 if name == "proprioception" else 1.0
        for tick in record.estimators[name].ticks:
            if not joints_of(tick).joints:
                continue
            reached, never = limit(0.99, sign * 0.24, sign * 0.24), limit(0.01, np.nan, 0.0)
            belief = JointMechanicsBelief(
                friction=np.array([6.5, 4.0]),
                friction_covariance=np.array([[0.2**2, -0.1], [-0.1, 10.0**2]]),
                noise=0.2,
                samples=100,
                mean_speed=0.02,
                lower=never if sign > 0 else reached,
                upper=reached if sign > 0 else never,
                detent=DetentBelief(
                    probability=0.99,
                    position=sign * 0.05,
                    variance=0.001**2,
                    force=9.0,
                    force_variance=0.25,
                ),
                force=sign * 6.2,
            )
            mechanics = JointMechanics(
                parent_id=0, child_id=HELD_BODY, models=dict.fromkeys(JointType, belief)
            )
            tick.values["joint_mechanics_latest"] = JointMechanicsBeliefs(joints=[mechanics])
    return record


@pytest.mark.parametrize("name", ["proprioception", "crossmodal"])
def test_the_summary_says_what_was_reached_whichever_way_the_axis_points(name: str) -> None:
    found = evaluate(felt_episode()).summary["modalities"][name]["joints"][0]["mechanics"]
    assert_allclose([found["coulomb"]["estimated"], found["coulomb"]["true"]], [6.5, 6.0])
    assert found["coulomb"]["inside_two_sigma"] is False
    assert found["viscous"]["inside_two_sigma"] is True
    assert_allclose(found["resistance"]["true"], 6.0 + 8.0 * 0.02)
    assert_allclose(found["resistance"]["std"] ** 2, 0.04 - 2 * 0.02 * 0.1 + 0.0004 * 100.0)
    upper, lower = found["upper"], found["lower"]
    assert upper["reached"]
    assert_allclose([upper["estimated"], upper["true"]], [0.24, 0.242 - START], atol=1e-12)
    assert upper["inside_two_sigma"]
    assert not lower["reached"]
    # The joint may well go on from where nothing stopped it.
    assert_allclose([lower["estimated"], lower["true"]], [0.0, -0.05 - START], atol=1e-12)
    assert lower["inside_two_sigma"]
    detent = found["detent"]
    assert_allclose([detent["position"], detent["estimated"], detent["true"]], [0.05, 9.0, 9.2])
    assert detent["inside_two_sigma"]


def test_what_was_felt_of_another_type_than_the_last_does_not_count() -> None:
    record = felt_episode()
    last = record.estimators["crossmodal"].ticks[-1]
    screw = {t: float(t == JointType.SCREW) for t in JointType}
    last.values["joints_latest"] = JointBeliefs(
        joints=[replace(joint, probabilities=screw) for joint in joints_of(last).joints]
    )
    felt = last.values["joint_mechanics_latest"].joints[0]
    felt = replace(felt, models={t: m for t, m in felt.models.items() if t != JointType.SCREW})
    last.values["joint_mechanics_latest"] = JointMechanicsBeliefs(joints=[felt])
    found = evaluate(record).summary["modalities"]["crossmodal"]["joints"][0]
    assert found.get("mechanics") is None


def test_a_bound_beyond_the_true_stop_is_wrong() -> None:
    record = felt_episode()
    for tick in record.station:
        tick.values["cheat_joint_mechanics"] = JointMechanicsTruth(
            friction=6.0, damping=8.0, lower=0.1, upper=0.242
        )
    found = evaluate(record).summary["modalities"]["crossmodal"]["joints"][0]["mechanics"]
    assert found["lower"]["inside_two_sigma"] is False


def test_the_eye_feels_no_force() -> None:
    results = evaluate(felt_episode())
    assert results.summary["modalities"]["vision"]["joints"][0]["mechanics"] is None
    felt = results.estimates[results.estimates.quantity == "joint_friction"]
    assert set(felt.modality) == {"proprioception", "crossmodal"}


def test_the_table_has_friction_limit_bound_and_force_with_the_truth() -> None:
    table = evaluate(felt_episode()).estimates
    last = table[(table.modality == "proprioception") & (table.time == table.time.max())]
    values = last.set_index(["quantity", "component"])[["estimate", "truth"]]
    assert_allclose(values.loc[("joint_friction", "coulomb")], [6.5, 6.0])
    assert_allclose(values.loc[("joint_limit", "upper")], [0.24, 0.241], atol=1e-12)
    assert ("joint_limit", "lower") not in values.index
    assert_allclose(values.loc[("joint_bound", "lower")].iloc[0], 0.0, atol=1e-12)
    assert_allclose(values.loc[("joint_force", "")].iloc[0], 6.2)


def test_the_line_tells_a_limit_from_a_bound_and_names_what_is_outside() -> None:
    summary = evaluate(felt_episode()).summary["modalities"]["crossmodal"]["joints"][0]
    line = mechanics_line(summary["mechanics"])
    assert "friction 6.50 ± 0.20 N [truth 6.00 N, OUTSIDE 2σ]" in line
    assert "upper end stop at 0.2400 ± 0.0020 m [truth 0.2410 m] (reached)" in line
    assert "lower end stop not above 0.0000 m (not reached)" in line
    assert "detent of 9.00 ± 0.50 N beyond friction at 0.0500 ± 0.0010 m [truth 9.20 N]" in line


def test_without_the_truth_no_verdict_is_given() -> None:
    record = without_truth(felt_episode())
    results = evaluate(record)
    found = results.summary["modalities"]["crossmodal"]["joints"][0]["mechanics"]
    for key in ("coulomb", "viscous", "resistance", "lower", "upper", "detent"):
        assert found[key]["inside_two_sigma"] is None, key
    assert "truth" not in mechanics_line(found)
    assert draw_mechanics(joint_episode(record)) is not None
    json.dumps(found)


def test_the_plot_shows_each_one_that_felt_the_joint() -> None:
    figure = draw_mechanics(joint_episode(felt_episode()))
    assert figure is not None
    (axes,) = figure.axes
    curves = [line for line in axes.lines if len(line.get_xdata()) > 10]
    assert len(curves) == 2
    for curve in curves:
        force = np.asarray(curve.get_ydata(), float)
        assert_allclose(force[np.isfinite(force)], 6.2)
        assert 20.0 < np.nanmax(np.asarray(curve.get_xdata(), float)) < 28.0  # [cm]
    assert draw_mechanics(joint_episode(synthetic_episode())) is None


def test_the_truth_is_the_models_range_and_damping() -> None:
    plant = MultibodyPlant(0.0)
    (instance,) = make_parser(plant).AddModels(str(SDF_DIR / "chest_drawer.sdf"))
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("__model__", instance))
    plant.Finalize()
    found = joint_mechanics(plant.GetJointByName("slide"), friction=5.0)
    assert found == JointMechanicsTruth(friction=5.0, damping=8.0, lower=0.0, upper=0.34)


def test_an_evaluation_counts_friction_and_the_stops_that_were_reached() -> None:
    record = felt_episode()
    summary = summarise(APPLICATION, record, evaluate(record)) | {"seed": 0}
    table = tidy_metrics(APPLICATION, "felt", [summary])
    felt = table[table.modality == "crossmodal"].set_index("metric")
    mechanics = summary["modalities"]["crossmodal"]["joints"][0]["mechanics"]
    assert_allclose(felt.value["resistance_error"], mechanics["resistance"]["error"])
    assert felt.unit["resistance_error"] == "N"
    assert felt.value["end_stops_inside_two_sigma"] == 1.0
    seen = table[table.modality == "vision"].metric
    assert not seen.str.startswith(("resistance", "end_stops")).any()
