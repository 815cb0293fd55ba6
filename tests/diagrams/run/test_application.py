"""A quantity that would never be recorded is refused."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder, LeafSystem, System
from pydrake.systems.primitives import ConstantVectorSource

from crossmodal.diagrams.run.application import Application, Station
from crossmodal.diagrams.run.episode import Episode
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


def episode(toy: Application, estimators: dict[str, System]) -> Episode:
    builder = DiagramBuilder()
    source = builder.AddSystem(ConstantVectorSource([1.0]))
    builder.ExportOutput(source.get_output_port(), "cheat_pose")
    toy = replace(
        toy,
        make_station=lambda *_: Station(diagram=builder.Build()),
        make_estimators=lambda *_: estimators,
    )
    return Episode(toy, Scenario(name="toy"))


def test_quantities_that_are_there_are_taken_of_whichever_estimators_run() -> None:
    fine = application(quantity("joints_latest"), quantity("grasp_latest", "hand"),
                       station=("cheat_pose",))  # fmt: skip
    for eye, hand in ((True, True), (True, False), (False, True), (False, False)):
        estimators: dict[str, System] = {}
        if eye:
            estimators["eye"] = Ports("joints_latest", "features_latest")
        if hand:
            estimators["hand"] = Ports("joints_latest", "grasp_latest")
        episode(fine, estimators)


@pytest.mark.parametrize(
    ("quantities", "station", "expected"),
    [
        ([quantity("jonts_latest")], (), "eye does not have an output port named jonts_latest"),
        ([quantity("grasp_latest")], (), "eye does not have an output port named grasp_latest"),
        ([quantity("grsp_latest", "hand")], (), "hand does not have an output port named grsp_"),
        ([], ("cheat_pos",), "station does not have an output port named cheat_pos"),
    ],
)
def test_a_mistyped_quantity_is_refused_in_one_line(
    quantities: list[Quantity], station: tuple[str, ...], expected: str
) -> None:
    both: dict[str, System] = {
        "eye": Ports("joints_latest", "features_latest"),
        "hand": Ports("joints_latest", "grasp_latest"),
    }
    with pytest.raises(ScenarioError) as caught:
        episode(application(*quantities, station=station), both)
    assert expected in str(caught.value)
