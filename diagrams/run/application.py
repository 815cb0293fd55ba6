"""The contract of an application: values and functions by which the commands run it.

An application is one experiment's robot, sensors, estimators and what is made of them. It is a
value, `Application`, that the module named in `diagrams/applications.py` holds. Whatever runs,
records, replays, evaluates and reports episodes knows applications by this contract alone.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, System

from crossmodal.diagrams.drawing.layers import Layers, Viewpoint
from crossmodal.diagrams.run.calibration import Calibration
from crossmodal.diagrams.run.experiment import CampaignPlot, Column, Experiment, Metric
from crossmodal.diagrams.run.own_object import OwnObject
from crossmodal.diagrams.run.record import EpisodeRecord, Event, Quantity, Tick
from crossmodal.diagrams.run.scenario import Scenario
from crossmodal.diagrams.run.sensor_streams.codecs import Topic
from crossmodal.systems.object_models.articulated_object import ArticulatedObject

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure
    from pydrake.geometry import Meshcat

    from crossmodal.diagrams.run.live.controls import Control

SCENE_PORT = "cheat_query_object"  # Of a station whose scene Meshcat and videos can show.


@dataclass(kw_only=True)
class Station:
    """The simulated world of one episode: plant, sensors and controllers.

    Attributes:
        diagram: Its output ports are what a robot has, measured and commanded; the truth leaves it
            only through ports named `cheat_...`. Estimators are connected by their ports' names.
            An output `task_status` (`TaskStatus`) says what the robot does and ends the episode, an
            output `cheat_query_object` (`QueryObject`) lets Meshcat and videos show the scene,
            which for the latter is its subsystem `scene_graph`.
        initialise: Sets the initial state in the root context.
        after_step: Called with the root context between two steps of the simulation, which it may
            make cheaper.
        warnings: What a user should know before it runs, a line each.
    """

    diagram: Diagram
    initialise: Callable[[Context], None] = lambda context: None
    after_step: Callable[[Context], None] | None = None
    warnings: Sequence[str] = ()


@dataclass(kw_only=True)
class Results:
    """What an episode comes to, computed once for table, summary, plots and report.

    Attributes:
        failure: Why the task was not done, in one line; None for a success.
        estimates: A tidy table over time with the columns `time`, `modality`, `quantity`,
            `component`, `estimate`, `std`, `covariance` and `truth`.
        summary: The application's part of `summary.json`, SI and rad. `modalities` holds one
            mapping for each estimator; the time of its ticks is added to it.
        events: What the record shows to have happened, besides what the robot said it did.
        plots: Pictures by file name, drawn when they are asked for; None for one that there is
            nothing to draw in.
        report: What a person reads after a run, from the whole summary.
        judged: Whether it is known that the task was done or not; a replay may lack the truth.
    """

    failure: str | None
    estimates: "pd.DataFrame"
    summary: dict[str, Any]
    events: Sequence[Event] = ()
    plots: Mapping[str, Callable[[], "Figure | None"]] = field(default_factory=dict)
    report: Callable[[Mapping[str, Any]], Sequence[str]] = lambda summary: []
    judged: bool = True

    @property
    def success(self) -> bool | None:
        """Whether the task was done; None where nobody can know."""
        return self.failure is None if self.judged else None


@dataclass(frozen=True, kw_only=True)
class Application:
    """All that the commands need to know of an application.

    Attributes:
        name: What a scenario's `system` says.
        description: One line.
        scenario: Its dataclass, `Scenario` or one below it.
        scenarios: Folder of the scenarios that come with it.
        resolve: Checks a scenario that was read from a file and fills in what depends on others of
            its values; raises a ScenarioError. Given and returned: the scenario, and the file.
        make_calibration: What the robot believes of its cameras and arms.
        make_station: Plant, sensors and controllers of a scenario with its seed. What the robot
            knows of itself comes from the calibration, what is true is drawn around it.
        make_estimators: The estimators that the scenario asks for, by name: a system or Diagram
            each. It gets no station: whatever they know is in scenario and calibration.
        quantities: Outputs of a scenario's estimators that are recorded. Read between two ticks,
            so they are functions of the state alone (`..._latest`). One that not all of them have
            names those that do.
        station_quantities: Outputs of a scenario's station that are recorded: what the robot did,
            and the truth.
        pictures: Outputs of a scenario's station that are colour images, of which some are kept.
        topics: How the streams of single ports of a scenario are written to `sensors.mcap`, where
            the usual way for their type will not do.
        evaluate: From what was recorded to what is shown of it.
        perceived: The articulated object as an estimator perceives it at a tick, by that of the
            tick before and the estimator's quantities; None where it has found none. What
            `crossmodal export` writes and `crossmodal stream` shows.
        acting: The estimator that the robot acts by, in a scenario.
        close_loop: Lets the station act by what its estimators say: connects them.
        view: Adds systems that draw into Meshcat what is believed and, hidden, what is true;
            returns what can be shown and hidden.
        viewpoint: From where a video shows the scene.
        film: Outputs of a scenario's station that a video shows, too; by default its `pictures`.
        controls: Sliders and switches of the live page of a scenario, which write to inputs of its
            station.
        replaceable: Keys of the scenario that only the estimators read, so that a replay may have
            other values of them; those that every scenario has are known.
        own_object: The assignments `key.path=value` that put an object of the user's own in place
            of a scenario's. Given: the scenario, its name or file, the object and the user's own
            assignments. None where there is nothing to be replaced.
        keep_files: What a scenario needs and what does not come with the program, for a run's
            folder: the scenario that names it there, relative to the folder, and by their places
            in it the files to be copied.
        task_in_words: What counts as done in a scenario, with its tolerances, in a sentence.
        glossary: What the words of its tables mean to someone who has read nothing else, by word;
            also those by which the estimators are called.
        portrait: File of the plot in which one sees what happens in an episode; empty: the first.
        labels: How tables and plots call the estimators, in order; without one, by its name.
        colors: '#RRGGBB' of the estimators.
        metrics: Figures of an episode for the tables of `crossmodal evaluate`.
        experiments: Scenarios to be repeated over seeds.
        overview: Columns of the table over all of them.
        campaign_plots: Pictures of many episodes, by file name.
    """

    name: str
    description: str
    scenario: type[Scenario]
    scenarios: Path
    make_station: Callable[[Any, Calibration], Station]
    make_estimators: Callable[[Any, Calibration], Mapping[str, System]]
    quantities: Callable[[Any], Sequence[Quantity]]
    evaluate: Callable[[EpisodeRecord], Results]
    resolve: Callable[[Any, Path], Any] = lambda scenario, path: scenario
    make_calibration: Callable[[Any], Calibration] = lambda scenario: Calibration()
    station_quantities: Callable[[Any], Sequence[Quantity]] = lambda scenario: ()
    pictures: Callable[[Any], Sequence[str]] = lambda scenario: ()
    topics: Callable[[Any], Mapping[str, Topic]] = lambda scenario: {}
    perceived: Callable[[ArticulatedObject | None, Tick], ArticulatedObject | None] | None = None
    acting: Callable[[Any], str] = lambda scenario: ""
    close_loop: Callable[[DiagramBuilder, Any, System, Mapping[str, System]], None] = (
        lambda builder, scenario, station, estimators: None
    )
    view: (
        Callable[[DiagramBuilder, Any, "Meshcat", System, Mapping[str, System]], Layers] | None
    ) = None
    viewpoint: Viewpoint = field(
        default_factory=lambda: Viewpoint(p_WV=np.array([2.0, 1.5, 1.5]), p_WT=np.zeros(3))
    )
    film: Callable[[Any], Sequence[str]] | None = None
    controls: Callable[[Any], Sequence["Control"]] = lambda scenario: ()
    replaceable: Sequence[str] = ("perception",)
    own_object: Callable[[Any, str, OwnObject, Sequence[str]], Sequence[str]] | None = None
    keep_files: Callable[[Any], tuple[Any, Mapping[str, Path]]] = lambda scenario: (scenario, {})
    task_in_words: Callable[[Any], str] = lambda scenario: ""
    glossary: Mapping[str, str] = field(default_factory=dict)
    portrait: str = ""
    labels: Mapping[str, str] = field(default_factory=dict)
    colors: Mapping[str, str] = field(default_factory=dict)
    metrics: Sequence[Metric] = ()
    experiments: Mapping[str, Experiment] = field(default_factory=dict)
    overview: Sequence[Column] = ()
    campaign_plots: Mapping[str, CampaignPlot] = field(default_factory=dict)
