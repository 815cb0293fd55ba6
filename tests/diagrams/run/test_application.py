"""A quantity that would never be recorded is refused."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder, LeafSystem, System
from pydrake.systems.primitives import ConstantVectorSource

from crossmodal.diagrams.applications import load_scenario
from crossmodal.diagrams.crossmodal.application import APPLICATION as CROSSMODAL
from crossmodal.diagrams.run.application import Application, Station, check_quantities
from crossmodal.diagrams.run.episode import Episode, build_estimators
from crossmodal.diagrams.run.record import Quantity
from crossmodal.diagrams.run.scenario import Scenario
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError


class Ports(LeafSystem):
    """A system with outputs of these names."""

    def __init__(self, *names: str) -> None:
        super().__init__()
        for name in names:
            self.DeclareVectorOutputPort(name, 1, lambda context, output: None)


def application(*quantities: Quantity, station: tuple[str, ...] = ()) -> Application:
    def nothing(*_: Any) -> Any:
        raise AssertionError("never called")

    return Application(
        name="toy",
        description="",
        scenario=Scenario,
        scenarios=Path(),
        make_station=nothing,
        make_estimators=nothing,
        quantities=quantities,
        station_quantities=[Quantity(port=port, model=np.zeros(1)) for port in station],
        evaluate=nothing,
    )


def quantity(port: str, *estimators: str) -> Quantity:
    return Quantity(port=port, model=np.zeros(1), estimators=estimators)


EYE, HAND = Ports("joints_latest", "features_latest"), Ports("joints_latest", "grasp_latest")
BOTH: dict[str, System] = {"eye": EYE, "hand": HAND}


def test_quantities_that_are_there_are_taken_of_whichever_estimators_run() -> None:
    fine = application(quantity("joints_latest"), quantity("grasp_latest", "hand"),
                       station=("cheat_pose",))  # fmt: skip
    for estimators in (BOTH, {"eye": EYE}, {"hand": HAND}, {}):
        check_quantities(fine, Ports("cheat_pose", "more"), estimators)


@pytest.mark.parametrize(
    ("quantities", "station", "expected"),
    [
        ([quantity("jonts_latest")], (), "estimator 'eye' has no output 'jonts_latest'; did you"
                                         " mean 'joints_latest'?"),
        ([quantity("grasp_latest")], (), "estimator 'eye' has no output 'grasp_latest'"),
        ([quantity("grsp_latest", "hand")], (), "estimator 'hand' has no output 'grsp_latest'"),
        ([quantity("grasp_latest", "hnd")], (), "'hand' has the output 'grasp_latest', but"),
        ([], ("cheat_pos",), "the station has no output 'cheat_pos'; did you mean 'cheat_pose'?"),
    ],
)  # fmt: skip
def test_a_mistyped_quantity_is_refused_in_one_line(
    quantities: list[Quantity], station: tuple[str, ...], expected: str
) -> None:
    with pytest.raises(ScenarioError) as caught:
        check_quantities(application(*quantities, station=station), Ports("cheat_pose"), BOTH)
    assert expected in str(caught.value)


def test_an_episode_does_not_begin_with_a_mistyped_quantity() -> None:
    builder = DiagramBuilder()
    source = builder.AddSystem(ConstantVectorSource([1.0]))
    builder.ExportOutput(source.get_output_port(), "cheat_pose")
    toy = replace(
        application(station=("cheat_poes",)),
        make_station=lambda *_: Station(diagram=builder.Build()),
        make_estimators=lambda *_: {},
    )
    with pytest.raises(ScenarioError, match="has no output 'cheat_poes'"):
        Episode(toy, Scenario(name="toy"))


@pytest.mark.parametrize("modality", ["vision", "proprioception", "crossmodal"])
def test_each_modality_has_what_is_recorded_of_it(modality: str) -> None:
    _, scenario = load_scenario("drawer", [f"modalities=[{modality}]"])
    estimators = build_estimators(CROSSMODAL, scenario)
    check_quantities(replace(CROSSMODAL, station_quantities=()), EYE, estimators)
