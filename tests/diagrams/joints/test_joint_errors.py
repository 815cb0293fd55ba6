from pathlib import Path

import numpy as np
import pytest
from synthetic_episode import synthetic_episode, without_truth

from crossmodal.diagrams.crossmodal.application import APPLICATION
from crossmodal.diagrams.evaluation.run_writer import write_run
from crossmodal.diagrams.joints.joint_errors import error_panels, errors_over_time, read_errors
from crossmodal.diagrams.joints.joint_metrics import joint_episode
from crossmodal.diagrams.run.record import EpisodeRecord
from crossmodal.systems.port_values import JointType

NAMES = ("vision", "proprioception", "crossmodal")


def errors_of(record: EpisodeRecord) -> dict:
    return errors_over_time(APPLICATION.evaluate(record).estimates)


@pytest.mark.parametrize("kind", [JointType.PRISMATIC, JointType.REVOLUTE, JointType.SCREW])
def test_errors_over_time_are_those_of_the_episode(kind: JointType) -> None:
    record = synthetic_episode(kind, seed=1)
    errors = errors_of(record)
    for name, series in joint_episode(record).series.items():
        at = np.searchsorted(series.times, errors[name].times - 1e-9)
        np.testing.assert_allclose(errors[name].configuration, np.abs(series.error[at]))
        np.testing.assert_allclose(errors[name].axis, series.axis_error[at], atol=1e-7)
        np.testing.assert_allclose(errors[name].probability, series.probability_true_type[at])
        assert errors[name].joint_type == str(kind)


@pytest.mark.parametrize(
    ("kind", "unit"),
    [(JointType.PRISMATIC, "mm"), (JointType.REVOLUTE, "deg"), (JointType.SCREW, "deg")],
)
def test_panels_are_in_units_for_people_and_in_the_order_asked_for(
    kind: JointType, unit: str
) -> None:
    errors = errors_of(synthetic_episode(kind))
    panels = error_panels([errors, {}], NAMES)
    assert panels[0].title == f"configuration error [{unit}]"
    assert all(tuple(panel.series) == NAMES for panel in panels)
    assert [panel.logarithmic for panel in panels] == [True, True, False]
    ((times, values),) = panels[0].series["crossmodal"]
    assert len(times) == len(values)
    scale = 1000.0 if unit == "mm" else 180.0 / np.pi
    np.testing.assert_allclose(values, scale * errors["crossmodal"].configuration)


def test_without_episodes_or_truth_there_is_nothing_to_draw() -> None:
    assert error_panels([{}], NAMES) == []
    assert errors_of(without_truth(synthetic_episode())) == {}


def test_errors_are_read_from_the_folders_that_have_a_table(tmp_path: Path) -> None:
    record = synthetic_episode()
    write_run(tmp_path / "a", APPLICATION, record, APPLICATION.evaluate(record))
    (read,) = read_errors([tmp_path / "a", tmp_path / "none"])
    for name, errors in errors_of(record).items():
        np.testing.assert_allclose(read[name].configuration, errors.configuration)
