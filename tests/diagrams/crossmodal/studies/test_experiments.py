import pytest

from crossmodal.diagrams.crossmodal.application import APPLICATION
from crossmodal.diagrams.crossmodal.scenario import SCENARIO_FOLDER
from crossmodal.diagrams.crossmodal.studies.experiments import EXPERIMENTS
from crossmodal.diagrams.evaluation.metric_table import EPISODE_METRICS, TICK_METRICS

METRICS = {
    metric.name: metric for metric in (*EPISODE_METRICS, *APPLICATION.metrics, *TICK_METRICS)
}


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_what_an_experiment_says_of_a_metric_is_shown_in_a_table(name: str) -> None:
    experiment = EXPERIMENTS[name]
    for metric in (*experiment.references, *experiment.without):
        assert METRICS[metric].title
        assert METRICS[metric].cell is not None


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_every_experiment_has_its_scenario(name: str) -> None:
    assert (SCENARIO_FOLDER / f"{EXPERIMENTS[name].scenario}.yaml").is_file()


def test_every_column_of_the_overview_is_a_metric_of_its_kind() -> None:
    for column in APPLICATION.overview:
        assert METRICS[column.metric].by_estimator == bool(column.estimator)


def test_no_two_metrics_have_one_name() -> None:
    assert len(METRICS) == len((*EPISODE_METRICS, *APPLICATION.metrics, *TICK_METRICS))


def test_a_deviation_in_another_unit_than_the_truths_is_no_figure() -> None:
    drawer = {"type_true": "prismatic", "type_estimated": "prismatic", "configuration_std": 0.01}
    of_another = drawer | {"type_estimated": "revolute"}
    unknown = of_another | {"type_true": None}
    metric, right = METRICS["configuration_std"], METRICS["type_right"]
    found = [{"joints": [joint]} for joint in (drawer, of_another, unknown)]
    assert [metric.value(one) for one in found] == [0.01, None, 0.01]
    assert [metric.unit_in(one) for one in found] == ["m", "m", "rad"]
    assert [right.value(one) for one in found] == [True, False, None]
