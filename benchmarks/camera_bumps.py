"""Knocks against the camera in whole episodes: are they told, and does what is claimed still hold?

    python -m benchmarks.camera_bumps [drawer cupboard-door] [--seeds 0:10] [--out runs/bumps]

Each seed draws the camera's turn (of `SIZES`, one after the other, about any axis), a shift of some
millimetres, and when it happens: before the hand pulls or while it does. Episodes that are in the
folder already are not run again; another version of the program needs another folder.

Printed for each episode: after how long the knock was told (no: never), then for vision and for the
cross-modal network the share of ticks from the knock on whose configuration is within two and three
reported deviations, the root mean square of the error, and error and deviation at the end.
"""

import json
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from tqdm import tqdm

from benchmarks.fault_matrix import deviations
from crossmodal.diagrams.applications import load_scenario
from crossmodal.diagrams.evaluation.seeds import parse_seeds
from crossmodal.diagrams.evaluation.stream_faults import fault_spans
from crossmodal.diagrams.joints.joint_metrics import joint_episode
from crossmodal.diagrams.run.episode import run_episode
from crossmodal.diagrams.run.scenario import CameraBump

SIZES = (0.3, 1.0, 2.0)  # [deg]
SHIFT = 0.003  # Standard deviation along each axis, [m].
TIMES = {"before": (1.0, 2.5), "while": (6.0, 11.0)}  # [s]
NETWORKS = ("vision", "crossmodal")
HEADER = "| episode | turn, deg | when, s | told after, s | " + " | ".join(
    f"{name}: inside 2, 3 | RMS | at the end (claimed), mm or mrad" for name in NETWORKS
)


def bump_of(seed: int) -> CameraBump:
    """The knock of a seed."""
    rng = np.random.default_rng([seed, 7])
    axis = rng.standard_normal(3)
    turn = SIZES[seed % len(SIZES)] * axis / np.linalg.norm(axis)
    span = list(TIMES.values())[seed // len(SIZES) % len(TIMES)]
    return CameraBump(
        start=float(rng.uniform(*span)),
        rotation=turn,
        translation=SHIFT * rng.standard_normal(3),
    )


def outcome(name: str, seed: int) -> dict[str, Any]:
    """What an episode with a knock came to; errors in [m] or [rad]."""
    bump = bump_of(seed)
    application, scenario = load_scenario(name, [f"modalities=[{','.join(NETWORKS)}]"])
    disturbances = replace(scenario.disturbances, camera_bumps=[bump])
    record = run_episode(application, replace(scenario, seed=seed, disturbances=disturbances))
    told = [span.start for span in fault_spans(record) if span.stream == "camera"]
    found: dict[str, Any] = {
        "turn": float(np.linalg.norm(bump.rotation)),
        "start": bump.start,
        "told": min(told) - bump.start if told else None,
        "mistrusted": sorted({s.stream for s in fault_spans(record)} - {"camera"}),
    }
    episode = joint_episode(record)
    for network in NETWORKS:
        series = episode.series[network]
        z = deviations(series)
        known = (series.times > bump.start) & np.isfinite(series.error)
        claims = z[(series.times > bump.start) & ~np.isnan(z)]
        last = np.flatnonzero(known)[-1:]
        found[network] = {
            "ticks": len(claims),
            "inside_two": float(np.mean(claims < 2.0)) if len(claims) else None,
            "inside_three": float(np.mean(claims < 3.0)) if len(claims) else None,
            "rms": float(np.sqrt(np.mean(series.error[known] ** 2))) if len(last) else None,
            "end": [*map(float, (*series.error[last], *series.configuration_std[last]))],
        }
    return found


def row(name: str, seed: int, found: dict[str, Any]) -> str:
    """A line of the table."""
    told = "**no**" if found["told"] is None else f"{found['told']:.2f}"
    cells = [f"{name} {seed}", f"{found['turn']:.1f}", f"{found['start']:.1f}", told]
    for network in NETWORKS:
        one = found[network]
        if not one["end"]:
            cells += ["nothing claimed", "", ""]
            continue
        inside = [f"{100 * one[key]:.0f}" for key in ("inside_two", "inside_three")]
        error, deviation = (1e3 * value for value in one["end"])
        cells += [" / ".join(inside) + " %", f"{1e3 * one['rms']:.2f}"]
        cells.append(f"{error:.2f} ({deviation:.2f})")
    return "| " + " | ".join(cells) + " |"


def main(
    scenarios: Annotated[list[str] | None, typer.Argument(help="Their names.")] = None,
    seeds: Annotated[str, typer.Option(help="FIRST:LAST, or how many from 0 on.")] = "0:12",
    out: Annotated[Path, typer.Option(help="Folder of the outcomes.")] = Path("runs/bumps"),
) -> None:
    """Prints the table, and the figures over all."""
    out.mkdir(parents=True, exist_ok=True)
    cases = [(name, seed) for name in scenarios or ["drawer"] for seed in parse_seeds(seeds)]
    results = []
    for name, seed in tqdm(cases, unit="episode", disable=None):
        file = out / f"{name}-{seed}.json"
        if not file.exists():
            text = json.dumps(outcome(name, seed))
            file.write_text(text)
        results.append(json.loads(file.read_text()))
    print(HEADER + " |\n|" + "---|" * (HEADER.count(" | ") + 1))
    for (name, seed), found in zip(cases, results, strict=True):
        print(row(name, seed, found))
    soon = sum(found["told"] is not None and 0.0 <= found["told"] <= 1.0 for found in results)
    print(f"\n- told within 1 s: {soon} of {len(results)}")
    for network in NETWORKS:
        ticks = np.array([found[network]["ticks"] for found in results], dtype=float)
        for key, words in (("inside_two", "two"), ("inside_three", "three")):
            shares = np.array([found[network][key] or 0.0 for found in results])
            total = float(ticks @ shares / max(ticks.sum(), 1.0))
            most = int(np.sum(shares[ticks > 0] >= 0.95))
            print(
                f"- {network}: inside {words} deviations {100 * total:.1f} % of the ticks; at least"
                f" 95 % in {most} of {int(np.sum(ticks > 0))} episodes"
            )


if __name__ == "__main__":
    typer.run(main)
