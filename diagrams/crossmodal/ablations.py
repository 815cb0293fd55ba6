"""The cross-modal flows of information, each shown by cutting the one wire that carries it.

An episode is simulated once and its sensor streams are kept; the cross-modal network then perceives
them twice, whole and with the wire cut, so that nothing else differs.
"""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from diagrams.crossmodal.scenario import load_scenario
from diagrams.joints.joint_record import summarise
from diagrams.run.episode import run_episode
from diagrams.run.replay import Wiring, load_recorded_scenario, replay
from diagrams.run.run_folder import (
    SENSORS_FILE,
    fingerprint,
    open_run_folder,
    write_run,
    write_text,
)
from diagrams.run.yaml_schema import ScenarioError, suggestion
from systems.port_values import JointType

_RESULT_FILE = "ablation.json"
WIRINGS = ("whole", "cut")


@dataclass(kw_only=True)
class Ablation:
    """A flow of information, where it matters, and the wire that carries it.

    Attributes:
        flow: What is shown, in one line.
        scenario: Its name.
        wire: One of `CROSSMODAL_WIRES`.
        overrides: Assignments to the scenario.
    """

    flow: str
    scenario: str
    wire: str
    overrides: list[str] = field(default_factory=list)


_DARK = ["disturbances.lights_off=[{start: 14.0}]"]

ABLATIONS = {
    "grasp-in-the-dark": Ablation(
        flow="the grasp learnt with the eye carries the hand when the light is off",
        scenario="cupboard-door",
        wire="held_body_to_grasp",
        overrides=_DARK,
    ),
    "taught-by-the-eye": Ablation(
        flow="what the eye has corrected carries the hand's reading when the light is off",
        scenario="cupboard-door",
        wire="features_to_held_body",
        overrides=_DARK,
    ),
    "body-in-the-hand": Ablation(
        flow="the body felt by the hand tells the eye which features are its own",
        scenario="drawer-lights-off",
        wire="held_body_to_vision",
    ),
    "behind-the-arm": Ablation(
        flow="the body felt by the hand tells the eye which features are its own, once they show",
        scenario="door-occluded",
        wire="held_body_to_vision",
    ),
    "seen-reference": Ablation(
        flow="a body that only the eye follows is the reference of a joint felt by the hand",
        scenario="box-lid",
        wire="visual_bodies_to_joints",
    ),
}


def find_ablation(name: str) -> Ablation:
    if name not in ABLATIONS:
        raise ScenarioError(f"unknown ablation '{name}'; {suggestion(name, ABLATIONS)}")
    return ABLATIONS[name]


def run_ablation(ablation: Ablation, seed: int, folder: Path) -> dict[str, Any]:
    """Simulates one episode and perceives it whole and cut; a finished one is read instead.

    Returns:
        By wiring, the joint's summary at the end of the episode, see `summarise`.
    """
    scenario = load_scenario(ablation.scenario, [*ablation.overrides, f"seed={seed}"])
    scenario.modalities = ["crossmodal"]
    key = {**fingerprint(scenario), "wire": ablation.wire}
    try:
        known = json.loads((folder / _RESULT_FILE).read_text(encoding="utf-8"))
        if {name: known.get(name) for name in key} == key:
            return dict(known["wirings"])
    except (OSError, ValueError):
        pass
    open_run_folder(folder, force=True)
    sensors_file = folder / SENSORS_FILE
    try:
        episode = run_episode(scenario, seed, sensors_file=sensors_file)
        if episode.interrupted:
            raise KeyboardInterrupt
        write_run(folder, episode)
        result = replay(
            folder,
            load_recorded_scenario(folder),
            dict(zip(WIRINGS, (Wiring(), Wiring(cut=[ablation.wire])), strict=True)),
        )
    finally:
        sensors_file.unlink(missing_ok=True)  # Some hundred MB, and the seed makes them again.
    perceived = summarise(result)["modalities"]
    wirings = {name: perceived[name]["joints"][0] for name in WIRINGS}
    write_text(folder / _RESULT_FILE, json.dumps(key | {"wirings": wirings}, indent=2) + "\n")
    return wirings


def run_ablations(
    names: Sequence[str],
    seeds: Sequence[int],
    folder: Path,
    progress: Callable[[], object] = lambda: None,
) -> str:
    """Runs ablations over seeds; resumable.

    Returns:
        Their table in Markdown.
    """
    results: dict[str, list[dict[str, Any]]] = {}
    for name in names:
        ablation = find_ablation(name)
        results[name] = []
        for seed in seeds:
            place = folder / f"{name}-{seed:04d}"
            results[name].append(run_ablation(ablation, seed, place))
            progress()
    return table(results)


def table(results: dict[str, list[dict[str, Any]]]) -> str:
    """Median (worst) error of the joint at the end, whole and cut, as a Markdown table."""
    lines = [
        "| flow | scenario | wire cut | | joint type right | configuration error | axis error |",
        "|---|---|---|---|---|---|---|",
    ]
    for name, rows in results.items():
        ablation = find_ablation(name)
        for wiring in WIRINGS:
            joints = [row[wiring] for row in rows]
            first = wiring == WIRINGS[0]
            about = (ablation.flow, ablation.scenario, f"`{ablation.wire}`") if first else ("",) * 3
            lines.append(f"| {' | '.join((*about, wiring, *_cells(joints)))} |")
    return "\n".join(lines) + "\n"


def _cells(joints: list[dict[str, Any]]) -> tuple[str, str, str]:
    right = sum(joint["type_estimated"] == joint["type_true"] for joint in joints)
    slides = joints[0]["type_true"] == JointType.PRISMATIC
    scale, unit = (1e3, "mm") if slides else (180.0 / np.pi, "deg")
    return (
        f"{right}/{len(joints)}",
        _spread([joint["configuration_error"] for joint in joints], scale, unit),
        _spread([joint["axis_angle_error"] for joint in joints], 180.0 / np.pi, "deg"),
    )


def _spread(values: list[float | None], scale: float, unit: str) -> str:
    known = [scale * abs(value) for value in values if value is not None]
    if not known:
        return "-"
    lost = f", none in {len(values) - len(known)}" if len(known) < len(values) else ""
    return f"{np.median(known):.2g} ({max(known):.2g}) {unit}{lost}"
