"""What an episode comes to and how it is drawn, from a record that is made up."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure
from pydrake.math import RigidTransform

from crossmodal.diagrams.applications import load_scenario
from crossmodal.diagrams.clutter.application import APPLICATION
from crossmodal.diagrams.clutter.estimators import load_model
from crossmodal.diagrams.clutter.results.gains import touch_gains, view_gains
from crossmodal.diagrams.clutter.results.plots import draw_claim, draw_gains, draw_stages
from crossmodal.diagrams.clutter.results.results import evaluate
from crossmodal.diagrams.drawing.table import Table
from crossmodal.diagrams.evaluation.words import words_of
from crossmodal.diagrams.run.calibration import Calibration
from crossmodal.diagrams.run.record import EpisodeRecord, EstimatorRecord, Tick
from crossmodal.systems.active.touch_planning import expected_squared_distance
from crossmodal.systems.active.view_planner import ViewPlannerConfig, hemisphere
from crossmodal.systems.port_values import (
    NO_MEASUREMENT,
    NO_TOUCH,
    UNKNOWN_POSE,
    ObjectPose,
    PoseMeasurement,
    TouchRequest,
    ViewRequest,
    of_mesh,
)
from crossmodal.systems.pose.target_model import TargetModel

X_WM = np.eye(4)
X_WM[:3, 3] = [0.5, 0.0, 0.12]
SIGMA = [3e-2, 4e-3, 3e-3, 3e-3, 2e-3]  # Of the translation after each measurement, [m].


def belief(model: TargetModel, number: int) -> ObjectPose:
    rng, X = np.random.default_rng(number), X_WM.copy()
    X[0, 3] += SIGMA[number]
    samples = np.tile(X, (200, 1, 1))
    samples[:, :3, 3] += SIGMA[number] * rng.normal(size=(200, 3))
    covariance = np.diag(np.repeat([1e-2, SIGMA[number]], 3) ** 2)
    return replace(
        UNKNOWN_POSE,
        known=True,
        number=number,
        X=X,
        covariance=covariance,
        joint=covariance,
        samples=samples,
        calibration=np.zeros((200, 0)),
        middle=model.middle,
    )


def measurements(eye: np.ndarray) -> list[PoseMeasurement]:
    wall = X_WM[:3, 3] + 0.02 * np.random.default_rng(0).normal(size=(50, 3))
    line = np.zeros((1, 2, 3))
    return [
        NO_MEASUREMENT,
        PoseMeasurement(kind="view", number=1, points=wall, eye=eye),
        PoseMeasurement(kind="touch", number=2, points=wall[:1], free=line),
        PoseMeasurement(kind="touch", number=3, free=line),
        PoseMeasurement(kind="touch", number=4),
    ]


@pytest.fixture(scope="module")
def record() -> EpisodeRecord:
    _, scenario = load_scenario(
        "pose-estimation", ["target.object=oil", "views.count=1", "touches.chosen_touches=3"]
    )
    model = load_model(scenario)
    X_WC = hemisphere(X_WM[:3, 3], ViewPlannerConfig())[0]
    X_WB = np.eye(4)
    X_WB[:3, 3] = X_WM[:3, 3]
    view = ViewRequest(
        number=1, X_WC=X_WC, box_edges=np.full(3, 30 * scenario.views.cell), X_WB=X_WB, gain=90.0
    )
    touches = [NO_TOUCH, *(TouchRequest(number=n, gain=1e-5 / n) for n in (1, 2, 3))]
    touches.append(TouchRequest(number=3, done=True, why="all touches are done"))
    X_WO = RigidTransform(of_mesh(X_WM, model.middle))
    station, ticks = [], []
    for number, measured in enumerate(measurements(X_WC[:3, 3])):
        values = {
            "cheat_object_pose": X_WO,
            "pose_measurement": measured,
            "view_latest": view,
            "touch_latest": touches[number],
        }
        for _ in range(2):
            time = 0.1 * len(ticks)
            station.append(Tick(time=time, values=values))
            ticks.append(Tick(time=time, values={"object_pose_latest": belief(model, number)}))
    return EpisodeRecord(
        scenario=scenario,
        calibration=Calibration(),
        station=station,
        estimators={name: EstimatorRecord(ticks=ticks) for name in scenario.modalities},
        duration=1.0,
        wall_time=1.0,
    )


def test_stages_say_how_measurements_ended(record: EpisodeRecord) -> None:
    stages = evaluate(record).summary["pose"]["stages"]
    assert [stage["outcome"] for stage in stages] == [None, 50, "contact", "miss", "unreachable"]
    assert [stage["stage"] for stage in stages] == ["guess", "view", "touch", "touch", "touch"]
    for stage, sigma in zip(stages, SIGMA, strict=True):
        assert stage["translation_error"] == pytest.approx(sigma)
        assert stage["distance"] == pytest.approx(1.0)
        # Of three normal coordinates, 95 % lie within 2.80 standard deviations.
        assert stage["translation_claimed"] == pytest.approx(2.80 * sigma, rel=0.15)
        assert stage["inside_claim"]


def test_realised_gains_are_those_of_grid_and_belief(record: EpisodeRecord) -> None:
    model = load_model(record.scenario)
    (seen,) = view_gains(record)
    assert (seen.number, seen.expected) == (1, 90.0)
    assert seen.realised > 10.0
    stages = evaluate(record).summary["pose"]["stages"]
    touched = touch_gains(record, stages, model)
    assert [gain.number for gain in touched] == [2, 3, 4]
    np.testing.assert_allclose([gain.expected for gain in touched], 1e-5 / np.array([1, 2, 3]))
    before, after = (belief(model, number).as_met(np.zeros((6, 0))) for number in (1, 2))
    expected = expected_squared_distance(before.covariance - after.covariance, before.X, model)
    assert touched[0].realised == pytest.approx(float(expected))
    met = [stage["as_met"]["adi"] for stage in stages]
    assert touched[0].true == pytest.approx(met[1] ** 2 - met[2] ** 2)
    # As much was believed before and after: what is left is that of the samples.
    assert abs(touched[1].realised) < 0.1 * touched[0].realised


def test_a_touch_that_was_not_reached_does_not_say_how_the_arm_is_displaced(
    record: EpisodeRecord,
) -> None:
    def first_distance(*displaced: np.ndarray) -> float:
        """As met, of the guess."""
        station, ticks = [], []
        for tick in record.estimators["density"].ticks:
            known = tick.values["object_pose_latest"]
            joint = np.eye(12)
            joint[:6, :6] = known.joint
            known = replace(
                known, joint=joint, calibration=np.random.default_rng(0).normal(size=(200, 6))
            )
            ticks.append(replace(tick, values={"object_pose_latest": known}))
        for tick in record.station:
            measured = tick.values["pose_measurement"]
            if measured.kind == "touch":
                n = min(measured.number - 2, len(displaced) - 1)
                measured = replace(measured, displaced=displaced[n])
            station.append(replace(tick, values={**tick.values, "pose_measurement": measured}))
        estimators = dict.fromkeys(record.estimators, EstimatorRecord(ticks=ticks))
        again = replace(record, station=station, estimators=estimators)
        stages = evaluate(again).summary["pose"]["stages"]
        return float(stages[0]["as_met"]["distance"])

    nowhere, somewhere = np.zeros((6, 6)), 0.01 * np.eye(6)
    expected = first_distance(somewhere)
    assert first_distance(nowhere, somewhere) == expected
    assert first_distance(nowhere) != pytest.approx(expected)


def test_touches_by_another_criterion_have_no_gain_to_compare(record: EpisodeRecord) -> None:
    scenario = record.scenario
    touches = replace(scenario.touches, criterion="log-det")
    other = replace(record, scenario=replace(scenario, touches=touches))
    assert touch_gains(other, [], load_model(scenario)) == []


def test_plots_are_drawn(record: EpisodeRecord) -> None:
    plots = evaluate(record).plots
    figures = {name: draw() for name, draw in plots.items()}
    assert set(figures) == {"stages.png", "gains.png", "claim.png"}
    for figure in figures.values():
        assert isinstance(figure, Figure)
        figure.canvas.draw()
        for axes in figure.axes:
            assert axes.get_title(loc="left")
    translation, _ = figures["stages.png"].axes
    errors = next(line for line in translation.lines if line.get_linestyle() == "-")
    np.testing.assert_allclose(errors.get_ydata(), 1e3 * np.array(SIGMA))
    views, touches = figures["gains.png"].axes
    assert [label.get_text() for label in views.get_xticklabels()] == ["view 1\n50 points"]
    ends = [label.get_text().split("\n")[1] for label in touches.get_xticklabels()]
    assert ends == ["contact", "miss", "unreachable"]


def test_without_the_truth_there_is_nothing_to_compare(record: EpisodeRecord) -> None:
    stages = evaluate(record).summary["pose"]["stages"]
    blind = {"density": [{**stage, "adi": np.nan} for stage in stages]}
    assert draw_stages(blind, 1) is None
    assert draw_claim(blind, 1, 12.6) is None
    assert draw_gains([], [], {}, "density", 1) is None


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("pose", "7 touches have been made"),
        ("touches", "one of them has met the object. How far"),
        ("declutter", "nothing in the way of the target any more, and the object has truly not"),
    ],
)
def test_a_page_says_what_counts_as_done(name: str, words: str) -> None:
    assert words in APPLICATION.task_in_words(load_scenario(name)[1])


def test_every_word_that_a_page_explains_stands_in_a_table_or_in_what_is_printed() -> None:
    titles = [[metric.title] for metric in APPLICATION.metrics]
    table = Table(header=["", *APPLICATION.labels.values()], rows=titles)
    printed = [
        "grasp of the oil: placed (done)",
        "density guess",
        "density view 1",
        "density touch 2",
    ]
    assert set(words_of(APPLICATION, [table], printed)) >= set(APPLICATION.glossary)
