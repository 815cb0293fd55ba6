"""Times one episode: each filter's tick, and where the wall time goes.

    python -m benchmarks.episode [--seed 0] [--scenario drawer]

Simulated tick by tick, all estimators side by side. Before each tick every sensor image and
then every filter's posterior is evaluated in the order of the data flow; Drake keeps the result, so
each evaluation costs that system's own work and nothing is computed twice.
"""

from collections import defaultdict
from time import perf_counter
from typing import Annotated

import numpy as np
import typer
from pydrake.systems.framework import Context, System
from tqdm import tqdm

from crossmodal.diagrams.applications import load_scenario
from crossmodal.diagrams.run.episode import Episode
from crossmodal.diagrams.run.recorder import STATUS_PORT

IMAGES = ("color_measured", "depth_measured", "robot_mask")
# In the order of the data flow: system and the output that holds its posterior.
FILTERS = (
    ("end_effector_motion", "end_effector_estimated"),
    ("hand_bending", "hand_bending_estimated"),
    ("slip_detection", "slip_estimated"),
    ("held_body_motion", "body_prior"),
    ("feature_motion", "features_estimated"),
    ("rigid_body_motion", "body_motions_estimated"),
    ("held_body_motion", "body_motions_estimated"),
    ("grasp_model", "grasp_estimated"),
    ("kinematic_model", "joints_estimated"),
    ("joint_mechanics", "joint_mechanics_estimated"),
    ("arm_registration", "displacements_estimated"),
    ("end_effector_pose", "end_effector_estimated"),
    ("fingertip_motion", "fingertip_contact_estimated"),
    ("flap_tracker", "flap_plane_estimated"),
    ("hinge", "hinge_estimated"),
    ("flap_angle", "flap_angle_estimated"),
    ("flap_joint", "hinge_estimated"),
    ("tool_kinematics", "tool_estimated"),
)
MOVING = ("exploring", "flipping")  # Phases of the robot in which it is measured.


def timed_eval(system: System, port: str, root: Context) -> float:
    """Wall time of one evaluation, [s]."""
    context = system.GetMyContextFromRoot(root)
    began = perf_counter()
    system.GetOutputPort(port).Eval(context)
    return perf_counter() - began


def tick_times(episode: Episode, root: Context) -> dict[str, float]:
    """Wall time of each part of the tick that is due now, [s]."""
    times: dict[str, float] = defaultdict(float)
    for port in IMAGES:
        if any(estimator.HasInputPort(port) for estimator in episode.estimators.values()):
            times["rendering and camera noise"] += timed_eval(episode.station.diagram, port, root)
    for modality in episode.estimators:
        systems = {
            system.get_name(): system
            for system in episode.diagram.GetSubsystemByName(modality).GetSystems()
        }
        for name, port in FILTERS:
            if name in systems and systems[name].HasOutputPort(port):
                times[f"{modality}/{name}"] += timed_eval(systems[name], port, root)
    return times


def main(
    scenario: Annotated[str, typer.Option(help="Its name.")] = "drawer",
    seed: Annotated[int, typer.Option(help="Of the episode.")] = 0,
) -> None:
    """Prints the table."""
    application, chosen = load_scenario(scenario, [f"seed={seed}"])
    episode = Episode(application, chosen)
    simulator = episode.Start()
    root = simulator.get_mutable_context()
    station = episode.station.diagram
    parts: dict[str, list[float]] = defaultdict(list)
    period = chosen.network_period
    exploring = 0.0
    began = perf_counter()
    for tick in tqdm(range(1, int(chosen.duration / period)), desc="ticks", disable=None):
        start = perf_counter()
        simulator.AdvanceTo(tick * period)
        advance = perf_counter() - start
        status = station.GetOutputPort(STATUS_PORT).Eval(station.GetMyContextFromRoot(root))
        times = tick_times(episode, root)
        if status.done:
            break
        if status.phase in MOVING:
            exploring += period
            parts["physics, control, sensors"].append(advance)
            for name, value in times.items():
                parts[name].append(value)
    wall = perf_counter() - began
    report(parts, exploring, root.get_time() / wall, list(episode.estimators))


def report(
    parts: dict[str, list[float]], exploring: float, factor: float, modalities: list[str]
) -> None:
    print(f"\nReal-time factor of the whole episode: {factor:.2f}\n")
    print("| while the robot moves something | median [ms] | p95 [ms] | per simulated second [s] |")
    print("|---|---|---|---|")
    for name, values in parts.items():
        ms = 1e3 * np.array(values)
        share = np.sum(values) / exploring
        print(f"| {name} | {np.median(ms):.2f} | {np.percentile(ms, 95):.2f} | {share:.3f} |")
    for modality in modalities:
        ticks = 1e3 * np.sum([v for k, v in parts.items() if k.startswith(f"{modality}/")], axis=0)
        share = np.sum(ticks) / 1e3 / exploring
        print(
            f"| **{modality}, whole tick** | {np.median(ticks):.2f} |"
            f" {np.percentile(ticks, 95):.2f} | {share:.3f} |"
        )


if __name__ == "__main__":
    typer.run(main)
