"""A record of clearing the way that is made up: four actions, in which the target is moved."""

from dataclasses import replace

import numpy as np
from pydrake.math import RigidTransform

from crossmodal.diagrams.applications import load_scenario
from crossmodal.diagrams.clutter.scenario import object_names
from crossmodal.diagrams.run.calibration import Calibration
from crossmodal.diagrams.run.record import EpisodeRecord, EstimatorRecord, Tick
from crossmodal.plants.goods.clutter_density import NO_DENSITY
from crossmodal.systems.declutter.declutter_graph import DeclutterConfig, declutter_graph
from crossmodal.systems.declutter.declutter_sequence import UNREACHABLE
from crossmodal.systems.port_values import (
    NO_GRAPH,
    NO_MASKS,
    NO_PROGRESS,
    NO_TRIES,
    UNKNOWN_POSE,
    DeclutterAction,
    DeclutterProgress,
    DeclutterStep,
)
from tests.systems.declutter.scenes import image, rectangle

GRASP, PUSH = DeclutterAction.GRASP, DeclutterAction.PUSH
STEPS = (
    DeclutterStep(
        image=1,
        object=1,
        name="can",
        action=GRASP,
        outcome=UNREACHABLE,
        displacement=0.001,
        worked=False,
    ),
    DeclutterStep(
        image=2,
        object=1,
        name="can",
        action=GRASP,
        outcome="slipped",
        displacement=0.004,
        worked=False,
    ),
    DeclutterStep(
        image=3, object=1, name="can", action=GRASP, outcome="placed", displacement=0.3, worked=True
    ),
    DeclutterStep(
        image=4,
        object=2,
        name="",
        action=PUSH,
        outcome="pushed",
        displacement=np.inf,
        worked=True,
        others=(0,),
    ),
)
CLEARED = DeclutterProgress(steps=STEPS, done=True, found=True)


def made(progress: DeclutterProgress) -> EpisodeRecord:
    """An episode of four actions, in which the target is moved by 3 cm.

    Args:
        progress: At the end.
    """
    _, scenario = load_scenario("declutter", ["target.object=wineglass", "clutter.count=2"])
    target, can, other = (
        rectangle(0, "wineglass", (0.5, 0.0)),
        rectangle(1, "can", (0.55, 0.0)),
        rectangle(2, "", (0.45, 0.0)),
    )
    scenes = [(target, can, other)] * 3 + [(target, other), (target,)]
    graphs = [NO_GRAPH]
    for number, scene in enumerate(scenes, start=1):
        shown = image(*scene, number=number)
        graphs.append(declutter_graph(shown, "wineglass", {1: 0.9}, NO_TRIES, DeclutterConfig()))
    station = []
    beside, taken = object_names(scenario)
    for k, graph in enumerate(graphs):
        done = replace(progress, done=False, why="") if k + 1 < len(graphs) else progress
        steps = progress.steps[: max(k - 1, 0)]
        values = {
            "declutter_graph": graph,
            "declutter_progress": replace(done, steps=steps) if k else NO_PROGRESS,
            "object_masks": NO_MASKS,
            "cheat_clutter_density": replace(NO_DENSITY, hidden_above=0.4),
            "cheat_object_pose": RigidTransform([0.5 + 0.03 * (k > 3), 0.0, 0.1]),
            # The first one stays by the target's side, the other one is taken away.
            f"cheat_{beside}_pose": RigidTransform([0.5, 0.07, 0.1]),
            f"cheat_{taken}_pose": RigidTransform([0.5, -0.07 - 0.3 * (k > 3), 0.1]),
        }
        station.append(Tick(time=10.0 * k, values=values))
    believed = [Tick(time=t.time, values={"object_pose_latest": UNKNOWN_POSE}) for t in station]
    return EpisodeRecord(
        scenario=scenario,
        calibration=Calibration(),
        station=station,
        estimators={"density": EstimatorRecord(ticks=believed)},
        duration=60.0,
        wall_time=1.0,
    )
