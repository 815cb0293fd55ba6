"""What is recorded depends on the scenario; what would never be recorded is refused."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import DiagramBuilder, LeafSystem, System
from pydrake.systems.primitives import ConstantVectorSource
from pydrake.systems.sensors import ImageRgba8U

from crossmodal.diagrams.run.application import Application, Station
from crossmodal.diagrams.run.calibration import Calibration
from crossmodal.diagrams.run.episode import Episode, run_episode
from crossmodal.diagrams.run.folder.run_folder import SCENARIO_FILE, SENSORS_FILE
from crossmodal.diagrams.run.record import Quantity
from crossmodal.diagrams.run.recorded_scenario import check_replaced
from crossmodal.diagrams.run.replay import replay
from crossmodal.diagrams.run.scenario import CameraConfig, Scenario
from crossmodal.diagrams.run.sensor_streams.codecs import Topic
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError
from crossmodal.systems.port_values import StampedImage


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
        quantities=lambda scenario: quantities,
        station_quantities=lambda scenario: [
            Quantity(port=port, model=np.zeros(1)) for port in station
        ],
        evaluate=nothing,
    )


def quantity(port: str, *estimators: str) -> Quantity:
    return Quantity(port=port, model=np.zeros(1), estimators=estimators)


def episode(
    toy: Application, estimators: dict[str, System], scenario: Scenario | None = None
) -> Episode:
    builder = DiagramBuilder()
    source = builder.AddSystem(ConstantVectorSource([1.0]))
    builder.ExportOutput(source.get_output_port(), "cheat_pose")
    toy = replace(
        toy,
        make_station=lambda *_: Station(diagram=builder.Build()),
        make_estimators=lambda *_: estimators,
    )
    return Episode(toy, scenario or Scenario(name="toy"))


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
        ([quantity("jonts_latest")], (), "'eye': has no output 'jonts_latest', which `quantities`"),
        ([quantity("grasp_latest")], (), "'eye': has no output 'grasp_latest', which `quantities`"),
        ([quantity("grsp_latest", "hand")], (), "did you mean 'grasp_latest'? allowed: grasp_"),
        ([], ("cheat_pos",), "the station has no output 'cheat_pos', which `station_quantities`"),
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


def test_an_estimator_that_reads_what_there_is_not_is_told_what_there_is() -> None:
    class Reader(Ports):
        def __init__(self) -> None:
            super().__init__("joints_latest")
            self.DeclareVectorInputPort("encodr_window", 1)

    with pytest.raises(ScenarioError) as caught:
        episode(application(), {"eye": Reader()})
    said = str(caught.value)
    assert said.startswith("estimator 'eye' reads 'encodr_window', which the station does not have")
    assert "allowed: none" in said  # The truth is not among them.


def test_an_application_says_what_only_its_estimators_read() -> None:
    toy = application()
    check_replaced(toy, ["perception.gain=1"])
    own = replace(toy, replaceable=("filter_noise",))
    check_replaced(own, ["filter_noise=1", "variants.mine.of=eye", "calibration.noise.angle=1"])
    for change in ("perception.gain=1", "filter_noises=1"):
        with pytest.raises(ScenarioError, match=r"only filter_noise, modalities, .*`replaceable`"):
            check_replaced(own, [change])


def test_what_is_recorded_depends_on_the_scenario(tmp_path: Path) -> None:
    def ports(scenario: Scenario) -> list[str]:
        return [f"{name}_pose" for name in scenario.cameras]

    def image() -> AbstractValue:
        return AbstractValue.Make(StampedImage(time=0.0, image=ImageRgba8U(4, 3)))

    def station(scenario: Scenario, _: Calibration) -> Station:
        source = LeafSystem()
        for port in ports(scenario):
            source.DeclareVectorOutputPort(port, 1, lambda context, output: None)
        for name in scenario.cameras:
            source.DeclareAbstractOutputPort(f"{name}_image", image, lambda context, output: None)
        builder = DiagramBuilder()
        builder.AddSystem(source)
        for index in range(source.num_output_ports()):
            port = source.get_output_port(index)
            builder.ExportOutput(port, port.get_name())
        return Station(diagram=builder.Build())

    toy = replace(
        application(),
        make_station=station,
        make_estimators=lambda scenario, _: {"eye": Ports(*ports(scenario))},
        quantities=lambda scenario: [quantity(port) for port in ports(scenario)],
        station_quantities=lambda scenario: [quantity(port) for port in ports(scenario)],
        pictures=lambda scenario: [f"{name}_image" for name in scenario.cameras],
        topics=lambda scenario: {port: Topic(name=f"/of/{port}") for port in ports(scenario)},
    )
    for names in (["left"], ["left", "right", "wrist"]):
        scenario = Scenario(
            name="toy", duration=0.2, cameras={name: CameraConfig() for name in names}
        )
        run = tmp_path / str(len(names))
        run.mkdir()
        (run / SCENARIO_FILE).touch()
        record = run_episode(toy, scenario, sensors_file=run / SENSORS_FILE)
        for one in (record, replay(toy, run, scenario)):
            poses = {f"{name}_pose" for name in names}
            assert set(one.station[-1].values) == poses
            assert set(one.estimators["eye"].ticks[-1].values) == poses
            assert {picture.port for picture in one.pictures} == {f"{n}_image" for n in names}
        summary = make_reader((run / SENSORS_FILE).open("rb")).get_summary()
        assert summary is not None
        topics = {channel.topic for channel in summary.channels.values()}
        assert topics == {
            *(f"/of/{name}_pose" for name in names),
            *(f"/{name}_image" for name in names),
        }
