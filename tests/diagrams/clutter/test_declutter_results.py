"""What clearing the way comes to, from a record that is made up."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure
from numpy.testing import assert_allclose

from crossmodal.diagrams.clutter.estimators import make_calibration
from crossmodal.diagrams.clutter.results.declutter_results import (
    clearing_failure,
    declutter_metrics,
    declutter_report,
    declutter_summary,
    step_pictures,
)
from crossmodal.diagrams.clutter.scenario import object_names
from crossmodal.diagrams.clutter.start import true_offset
from crossmodal.diagrams.run.calibration import CalibrationErrors, draw_camera
from crossmodal.diagrams.run.record import EpisodeRecord
from crossmodal.maths import se3
from crossmodal.systems.declutter.declutter_graph import NOTHING_LEFT, TARGET_FREE
from crossmodal.systems.declutter.declutter_sequence import LEFT_ALONE
from crossmodal.systems.port_values import (
    NO_MASKS,
    NO_PROGRESS,
    ArmOffset,
    DeclutterProgress,
)
from tests.diagrams.clutter.declutter_record import CLEARED, STEPS, made


@pytest.fixture
def record() -> EpisodeRecord:
    return made(CLEARED)


def test_actions_are_counted_by_object_and_kind(record: EpisodeRecord) -> None:
    found = declutter_summary(record)
    assert [(a["object"], a["kind"], a["tries"], a["success"]) for a in found["actions"]] == [
        ("can", "grasp", 1, False),
        ("can", "grasp", 2, False),
        ("can", "grasp", 3, True),
        ("unknown", "push", 1, True),
    ]
    assert found["actions"][3]["displacement"] is None
    assert [a["out_of_the_way"] for a in found["actions"]] == [False, False, True, True]
    assert (found["in_the_way"], found["is_free"]) == (2, True)
    assert found["ended"] == f"the {TARGET_FREE}"
    beside, taken = object_names(record.scenario)
    assert found["near_before"] == sorted([beside, taken])
    assert found["near_after"] == [beside]


def test_each_image_has_its_graph_and_what_was_chosen_by_it(record: EpisodeRecord) -> None:
    found = declutter_summary(record)
    graphs = {graph["image"]: graph for graph in found["graphs"]}
    assert [*graphs] == [1, 2, 3, 4, 5]
    assert {a["image"]: a["number"] for a in found["actions"]} == {1: 1, 2: 1, 3: 1, 4: 2}
    for action in found["actions"]:
        assert graphs[action["image"]]["next"] == action["number"]
    edges = {edge["number"]: edge for edge in graphs[1]["edges"]}
    assert {n: edge["grasp_quality"] for n, edge in edges.items()} == {1: 0.9, 2: 0.0}
    assert {n: edge["action"] for n, edge in edges.items()} == {1: "grasp", 2: "push"}
    assert all(edge["hangs_on"] == graphs[1]["target"] == 0 for edge in edges.values())
    assert [len(graph["push"]) for graph in found["graphs"]] == [0, 0, 0, 1, 0]
    assert (graphs[5]["edges"], graphs[5]["next"], graphs[5]["why"]) == ([], None, TARGET_FREE)


def test_a_target_that_was_moved_and_seen_to_be_is_noticed(record: EpisodeRecord) -> None:
    found = declutter_summary(record)
    assert found["target_moved"] == pytest.approx(0.03)
    assert found["target_noticed"]
    unseen = tuple(replace(step, others=()) for step in STEPS)
    found = declutter_summary(made(DeclutterProgress(steps=unseen, done=True, found=True)))
    assert not found["target_noticed"]


def test_metrics_count_what_was_begun(record: EpisodeRecord) -> None:
    summary = {"clutter": declutter_summary(record)}
    values = {metric.name: metric.value(summary) for metric in declutter_metrics()}
    assert values == {
        "grasp_success": 0.5,
        "push_success": 1.0,
        "grasp_count": 2.0,
        "grasp_done": 1.0,
        "push_count": 1.0,
        "push_done": 1.0,
        "out_of_the_way": 2.0 / 3.0,
        "actions_per_object": 1.5,
        "near_before": 2.0,
        "near_after": 1.0,
        "is_free": True,
        "hidden_above": 0.4,
        "offset_error_before": None,
        "offset_error": None,
        "offset_inside": None,
        "moved_unnoticed": False,
        "noticed_wrongly": False,
    }


def test_what_the_arm_has_learned_of_its_offset_is_compared_with_the_truth(
    record: EpisodeRecord,
) -> None:
    scenario, view = record.scenario, se3.looking_at(np.array([0.4, 0.0, 0.7]), np.zeros(3))
    calibration, p = make_calibration(scenario), np.array([0.5, 0.0, 0.1])
    true = true_offset(scenario, calibration, view, p)
    assert 1e-4 < np.linalg.norm(true) < 0.03
    learned = ArmOffset(mean=true + np.array([0.003, 0.0, 0.004]), covariance=4e-6 * np.eye(3))
    for tick in record.station:
        tick.values["object_masks"] = replace(NO_MASKS, number=1, X_WC=view)
        tick.values["arm_offset"] = learned
    found = declutter_summary(replace(record, calibration=calibration))["arm_offset"]
    assert found["error_before"] == pytest.approx(np.linalg.norm(true))
    assert found["error"] == pytest.approx(0.005)
    assert found["inside_claim"]
    perfect = replace(
        scenario, calibration=replace(scenario.calibration, errors=CalibrationErrors())
    )
    assert_allclose(true_offset(perfect, calibration, view, p), 0.0, atol=1e-9)


def test_what_is_seen_too_near_is_met_farther_from_the_camera(record: EpisodeRecord) -> None:
    """On the camera's axis a wrong scale of depths counts, beside it a wrong focal length, too."""
    scenario, errors = record.scenario, CalibrationErrors(depth_scale=0.01, focal_length=0.01)
    scenario = replace(scenario, calibration=replace(scenario.calibration, errors=errors))
    calibration = make_calibration(scenario)
    view = se3.looking_at(np.array([0.4, 0.0, 0.7]), np.zeros(3))
    ((name, believed),) = calibration.cameras.items()
    camera = draw_camera(name, believed, errors, scenario.seed)
    scale, focal = camera.depth_scale, camera.intrinsics.focal_x / believed.intrinsics.focal_x
    assert abs(scale - 1.0) > 1e-4
    assert abs(focal - 1.0) > 1e-4
    ahead, beside = 0.5 * view[:3, 2], 0.1 * view[:3, 0]
    offset = true_offset(scenario, calibration, view, view[:3, 3] + ahead + beside)
    expected = (1.0 / scale - 1.0) * ahead + (1.0 / scale / focal - 1.0) * beside
    assert_allclose(offset, expected, atol=1e-12)


@pytest.mark.parametrize(
    ("progress", "note", "failure"),
    [
        (DeclutterProgress(done=True, found=True), "", None),
        (DeclutterProgress(done=True, found=True, why=LEFT_ALONE), "", None),
        (DeclutterProgress(done=True, found=True, why=NOTHING_LEFT), "", NOTHING_LEFT),
        (NO_PROGRESS, "", "the time was over while something was in the way"),
        (NO_PROGRESS, "the camera is broken", "the camera is broken"),
    ],
)
def test_what_is_still_in_the_way_is_a_failure(
    progress: DeclutterProgress, note: str, failure: str | None
) -> None:
    record = made(progress)
    assert clearing_failure(record, note) == failure
    assert declutter_summary(record)["is_free"] == (progress.done and not progress.why)


def test_each_image_has_its_picture_and_words(record: EpisodeRecord) -> None:
    pictures = step_pictures(record)
    assert [*pictures] == [f"step-{k:02d}.png" for k in range(1, 6)]
    titles = []
    for draw in pictures.values():
        figure = draw()
        assert isinstance(figure, Figure)
        titles.append(figure.get_suptitle())
    assert titles[0] == "grasp of 1 can: unreachable; went 0 cm"
    assert titles[3] == "push of 2 : pushed; is not seen any more, moved 0, too"
    assert titles[4] == TARGET_FREE


def test_a_person_reads_what_was_done(record: EpisodeRecord) -> None:
    lines = declutter_report(declutter_summary(record))
    assert lines[0] == "2 objects around the target:"
    assert lines[3] == "  grasp of the can: placed (done)"
    assert lines[-1] == f"  the {TARGET_FREE}"


def test_what_stays_is_said_with_the_reason(record: EpisodeRecord) -> None:
    graph = record.station[-2].values["declutter_graph"]
    root, other = graph.vertices
    stuck = replace(other, action=None, why="every push topples it")
    record.station[-1].values["declutter_graph"] = replace(graph, vertices=(root, stuck), number=9)
    summary = declutter_summary(record)
    assert summary["staying"] == [
        {"object": "unknown", "number": 2, "why": "every push topples it"}
    ]
    assert "  the unknown stays: every push topples it" in declutter_report(summary)
