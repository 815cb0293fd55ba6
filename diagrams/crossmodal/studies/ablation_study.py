"""What each connection between the senses is worth: networks, whole and cut, on the same data."""

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from crossmodal.diagrams.crossmodal.estimators import make_network
from crossmodal.diagrams.crossmodal.scenario import SCENARIO_FOLDER, Scenario, resolve
from crossmodal.diagrams.crossmodal.studies.ablations import Ablation, find_ablation
from crossmodal.diagrams.drawing.digits import written
from crossmodal.diagrams.evaluation.metric_table import readable
from crossmodal.diagrams.evaluation.run_writer import write_run
from crossmodal.diagrams.joints.joint_metrics import unit_of
from crossmodal.diagrams.run.application import Application
from crossmodal.diagrams.run.episode import run_episode
from crossmodal.diagrams.run.folder.fingerprint import fingerprint
from crossmodal.diagrams.run.folder.run_folder import SENSORS_FILE, make_folder, without_nan
from crossmodal.diagrams.run.folder.written_files import write_text
from crossmodal.diagrams.run.record import EpisodeRecord
from crossmodal.diagrams.run.replay import replay
from crossmodal.diagrams.run.scenario import parse_scenario, read_document

_RESULT_FILE = "ablation.json"
WIRINGS = ("whole", "cut")


def run_ablation(
    application: Application, ablation: Ablation, seed: int, folder: Path
) -> dict[str, Any]:
    """Simulates one episode and perceives it whole and cut; a finished one is read instead.

    Returns:
        By wiring, the joint's summary at the end of the episode, see `summarise_joint`.
    """
    path = SCENARIO_FOLDER / f"{ablation.scenario}.yaml"
    document = read_document(path, [*ablation.overrides, f"seed={seed}"])
    scenario = resolve(parse_scenario(Scenario, document, path), path)
    scenario = replace(scenario, modalities=["crossmodal"])
    key = {**fingerprint(application, scenario), "connection": ablation.connection}
    try:
        known = json.loads((folder / _RESULT_FILE).read_text(encoding="utf-8"))
        if {name: known.get(name) for name in key} == key:
            return dict(known["wirings"])
    except (OSError, ValueError):
        pass
    make_folder(folder)
    record = _perceive_whole_and_cut(application, ablation, scenario, folder)
    perceived = application.evaluate(record).summary["modalities"]
    wirings = {name: without_nan(perceived[name]["joints"][0]) for name in WIRINGS}
    write_text(folder / _RESULT_FILE, json.dumps(key | {"wirings": wirings}, indent=2) + "\n")
    return wirings


def _perceive_whole_and_cut(
    application: Application, ablation: Ablation, scenario: Scenario, folder: Path
) -> EpisodeRecord:
    """Simulates an episode, and replays it with the network whole and with the connection cut."""
    sensors_file = folder / SENSORS_FILE
    try:
        episode = run_episode(application, scenario, sensors_file=sensors_file)
        if episode.interrupted:
            raise KeyboardInterrupt
        write_run(folder, application, episode, application.evaluate(episode))
        calibration = application.make_calibration(scenario)
        period, perception = scenario.network_period, scenario.perception
        networks = {
            name: make_network("crossmodal", replace(perception, cut=cut), calibration, period)
            for name, cut in zip(WIRINGS, ([], [ablation.connection]), strict=True)
        }
        return replay(application, folder, scenario, networks)
    finally:
        sensors_file.unlink(missing_ok=True)  # Some hundred MB, and the seed makes them again.


def run_ablations(
    application: Application,
    names: Sequence[str],
    seeds: Sequence[int],
    folder: Path,
    progress: Callable[[str, int], object] = lambda name, seed: None,
) -> str:
    """Runs ablations over seeds; resumable.

    Args:
        progress: Called with an ablation's name and a seed once they have been run.

    Returns:
        Their table in Markdown.
    """
    results: dict[str, list[dict[str, Any]]] = {}
    for name in names:
        ablation = find_ablation(name)
        results[name] = []
        for seed in seeds:
            place = folder / f"{name}-{seed:04d}"
            results[name].append(run_ablation(application, ablation, seed, place))
            progress(name, seed)
    return table(results)


def table(results: dict[str, list[dict[str, Any]]]) -> str:
    """Median (worst) error of the joint at the end, whole and cut, as a Markdown table."""
    lines = [
        "| flow | scenario | connection cut | | joint type right | configuration error"
        " | axis direction error |",
        "|---|---|---|---|---|---|---|",
    ]
    for name, rows in results.items():
        ablation = find_ablation(name)
        for wiring in WIRINGS:
            joints = [row[wiring] for row in rows]
            first = wiring == WIRINGS[0]
            about = (ablation.flow, ablation.scenario, f"`{ablation.connection}`")
            about = about if first else ("",) * 3
            lines.append(f"| {' | '.join((*about, wiring, *_cells(joints)))} |")
    return "\n".join(lines) + "\n"


def _cells(joints: list[dict[str, Any]]) -> tuple[str, str, str]:
    right = sum(joint["type_estimated"] == joint["type_true"] for joint in joints)
    return (
        f"{right}/{len(joints)}",
        _spread(
            [joint["configuration_error"] for joint in joints], unit_of(joints[0]["type_true"])
        ),
        _spread([joint["axis_angle_error"] for joint in joints], "rad"),
    )


def _spread(values: list[float | None], unit_in_si: str) -> str:
    scale, unit = readable(unit_in_si)
    known = [scale * abs(value) for value in values if value is not None]
    if not known:
        return "-"
    lost = f", none in {len(values) - len(known)}" if len(known) < len(values) else ""
    median, most = float(np.median(known)), max(known)
    return f"{written(median)} ({written(most)}) {unit}{lost}"
