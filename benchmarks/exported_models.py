"""How exported models reopen and move, and how far they are from the truth.

Episodes are simulated, or recorded ones are perceived again. Each estimator's object is written as
SDF, opened in Drake, and moved to every configuration that was perceived; the body's pose there is
compared with the pose that was perceived at that tick. The truth is compared by the metric E of
ArticulateArena, here as a share of how far a joint that does not move would be from it.

    python -m benchmarks.exported_models drawer tripod --seeds 0:5
    python -m benchmarks.exported_models tests/recordings/*/ runs/a --change modalities=[vision]
"""

from collections.abc import Iterator, Sequence
from itertools import chain
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

from crossmodal.diagrams.applications import load_scenario
from crossmodal.diagrams.evaluation.seeds import parse_seeds
from crossmodal.diagrams.joints.joint_metrics import bodies_of
from crossmodal.diagrams.joints.joint_truth import Truth, truth_of_ticks
from crossmodal.diagrams.joints.perceived_object import body_name
from crossmodal.diagrams.run.application import Application
from crossmodal.diagrams.run.episode import run_episode
from crossmodal.diagrams.run.record import EpisodeRecord, Tick
from crossmodal.diagrams.run.replay import check_recorded, replay
from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.systems.object_models.articulated_object import ArticulatedObject, ObjectJoint
from crossmodal.systems.object_models.sdf import sdf

Deviation = tuple[float, float]  # [rad], [m]


class Reopened:
    """An exported object in Drake, with its root where it was perceived."""

    def __init__(self, found: ArticulatedObject) -> None:
        self._plant = MultibodyPlant(time_step=1e-3)
        Parser(self._plant).AddModelsFromString(sdf(found, "object"), "sdf")
        root = self._plant.GetFrameByName(found.root)
        self._plant.WeldFrames(self._plant.world_frame(), root, RigidTransform(found.X_WR))
        self._plant.Finalize()
        self._context = self._plant.CreateDefaultContext()

    def pose(self, frame: str, joint: ObjectJoint, q: float) -> Array:
        """X_WB (4, 4) of a body's frame with one joint at q and the others at zero."""
        positions = np.zeros(self._plant.num_positions())
        if joint.moves:
            positions[self._plant.GetJointByName(joint.name).position_start()] = q
        self._plant.SetPositions(self._context, positions)
        X_WB = self._plant.GetFrameByName(frame).CalcPoseInWorld(self._context)
        return np.asarray(X_WB.GetAsMatrix4())


def perceived_over_time(
    application: Application, ticks: Sequence[Tick]
) -> list[ArticulatedObject | None]:
    """The object at each tick of an estimator."""
    assert application.perceived is not None
    known: ArticulatedObject | None = None
    each = []
    for tick in ticks:
        known = application.perceived(known, tick)
        each.append(known)
    return each


def deviations(
    ticks: Sequence[Tick], each: Sequence[ArticulatedObject | None]
) -> Iterator[Deviation]:
    """By how much each perceived pose is off where the last object has its body at that q.

    Of bodies that are joined to the root and were seen. A body's pose is the one that the estimator
    reports, where it reports bodies, and else the object's own at that tick.
    """
    last = each[-1]
    assert last is not None
    model = Reopened(last)
    final = {joint.name: joint for joint in last.joints}
    for tick, found in zip(ticks, each, strict=True):
        if found is None or found.time != tick.time:
            continue
        measured = {body_name(body.body_id): body for body in bodies_of(tick).bodies}
        for body, joint in zip(found.bodies, found.joints, strict=True):
            end = final.get(joint.name)
            if end is None or end.type != joint.type or joint.parent != found.root:
                continue
            motion = measured.get(body.name)
            if motion is not None and not motion.is_seen:
                continue
            X_WB = body.X_WB if motion is None else motion.motion.X
            sign = -1.0 if joint.moves and joint.axis_P @ end.axis_P < 0.0 else 1.0
            e = se3.log(se3.inverse(model.pose(body.frame, end, sign * joint.q)) @ X_WB)
            yield float(np.linalg.norm(e[:3])), float(np.linalg.norm(e[3:]))


def score(found: ArticulatedObject, truth: Truth) -> float:
    """The metric E between the joint of an object and the true one, as a share of E(truth, fixed).

    Both with the travel that there was, in the frame of the body where it was closed, lengths in
    [m] and angles in [rad]. Of an object of several joints it is the one that was seen longest.
    """
    from articulatearena import cost_to_fixed, joint_metric, make_endpoint_pair, make_split_norm

    X_WB = np.ascontiguousarray(truth.X_WB[0])
    Ad = se3.adjoint(se3.inverse(X_WB))
    travel = truth.configuration - truth.configuration[0]
    turns = truth.type != "prismatic"
    climb = truth.pitch if truth.type == "screw" else 0.0
    moment = np.cross(truth.point_W, truth.axis_W) + climb * truth.axis_W
    S_W = np.concatenate([truth.axis_W, moment] if turns else [np.zeros(3), truth.axis_W])
    norm = make_split_norm(alpha=1.0)
    true = make_endpoint_pair(Ad @ S_W, float(travel.min()), float(travel.max()))
    joint, zero = max(found.joints, key=lambda joint: joint.updates), np.zeros(6)
    ends = (zero, zero)
    if joint.moves:
        ends = (Ad @ joint.S_P * joint.lower, Ad @ joint.S_P * joint.upper)
    distance = joint_metric(*ends, true.u.data, true.v.data, norm)
    return float(distance / cost_to_fixed((true.u.data, true.v.data), norm))


def replayed(folder: Path, changes: Sequence[str]) -> Iterator[str]:
    """A line for each estimator of a recorded run."""
    application, scenario = load_scenario(str(check_recorded(folder)), changes)
    yield from lines(folder.name, application, replay(application, folder, scenario))


def simulated(name: str, seed: int, changes: Sequence[str]) -> Iterator[str]:
    """A line for each estimator of an episode of a scenario."""
    application, scenario = load_scenario(name, [f"seed={seed}", *changes])
    yield from lines(f"{name}, seed {seed}", application, run_episode(application, scenario))


def lines(title: str, application: Application, record: EpisodeRecord) -> Iterator[str]:
    """A line for each estimator of an episode."""
    truth = truth_of_ticks(record.station)
    for name, estimator in record.estimators.items():
        each = perceived_over_time(application, estimator.ticks)
        last = each[-1] if each else None
        begin = f"{title:22s} {name:15s}"
        if last is None:
            yield f"{begin} none"
            continue
        off = np.array(list(deviations(estimator.ticks, each))).reshape(-1, 2)
        angle, length = np.rad2deg(off[:, 0]), 1e3 * off[:, 1]
        known = truth.type and not truth.parent_moves
        yield (
            f"{begin} {last.joints[-1].type:10s} {len(off):5d} {np.median(angle):6.2f}"
            f" {angle.max():6.2f} {np.median(length):6.2f} {length.max():6.2f}"
            f" {score(last, truth) if known else np.nan:6.3f}"
        )


def main(
    what: Annotated[list[str], typer.Argument(help="Scenarios, and folders of recorded runs.")],
    seeds: Annotated[str, typer.Option(help="Of the scenarios, like 0:5.")] = "0",
    change: Annotated[list[str] | None, typer.Option(help="KEY.PATH=VALUE, repeatable.")] = None,
) -> None:
    """Prints a line for each estimator of each episode."""
    print("                                                         off [deg]      off [mm]")
    print("run                    estimator       joint      ticks median    max median    max"
          " E/E(fixed)")  # fmt: skip
    for name in what:
        if Path(name).is_dir():
            found = replayed(Path(name), change or [])
        else:
            found = chain.from_iterable(
                simulated(name, seed, change or []) for seed in parse_seeds(seeds)
            )
        for line in found:
            print(line, flush=True)


if __name__ == "__main__":
    typer.run(main)
