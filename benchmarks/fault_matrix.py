"""Perceives recorded runs again while each of their sensor streams fails in each way.

    python -m benchmarks.fault_matrix RUN [RUN ...] [--out runs/faults]

A RUN is the folder of a run with `--record-sensors`. Each case is one stream, one fault and one
time: for 3 s before the object moves, in the middle of its motion, or once it rests again (as long
as the recording lasts). Sizes are those of `SIZES`. The cases of a run that are in the folder
already are not run again; another version of the program needs another folder.

Printed for each case: after how long the stream's monitor reported a fault (no: never), the
largest error of the configuration over its reported deviation from the fault on, the share of ticks
inside three, error and reported deviation at the end, and whether the truth was within two reported
deviations 1 s after the fault had ended.
"""

import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from tqdm import tqdm

from crossmodal.diagrams.applications import load_scenario
from crossmodal.diagrams.evaluation.stream_faults import fault_spans
from crossmodal.diagrams.joints.joint_metrics import JointSeries, joint_episode, motion_start
from crossmodal.diagrams.joints.joint_truth import Truth
from crossmodal.diagrams.run.application import Application
from crossmodal.diagrams.run.record import EpisodeRecord
from crossmodal.diagrams.run.replay import check_recorded, replay
from crossmodal.diagrams.run.scenario import Scenario
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError
from crossmodal.maths.arrays import Array
from crossmodal.systems.sensors.stream_fault import StreamFault

# By stream: its name in what is reported, and the size of each fault that has one. Encoders: seven
# angles [rad], then their rates. Wrench: torques [N m], then forces [N].
STREAMS = {
    "color_measured": "color",
    "depth_measured": "depth",
    "joint_state_window": "joint_state",
    "wrench_window": "wrench",
    "pressure_window": "pressure",
}
SIZES = {
    "color_measured": {"biased": [40.0], "drifting": [15.0]},  # Grey values of 255.
    "depth_measured": {"biased": [0.05], "drifting": [0.005]},  # [m]
    "joint_state_window": {  # 2.9 deg; 0.3 deg/s.
        "biased": [0.05] * 7 + [0.0] * 7,
        "drifting": [0.005] * 7 + [0.0] * 7,
    },
    "wrench_window": {
        "biased": [0.5] * 3 + [5.0] * 3,
        "drifting": [0.2] * 3 + [2.0] * 3,
    },
    "pressure_window": {"biased": [5e3], "drifting": [2e3]},  # [Pa]
}
COMMON_SIZES = {"delayed": [0.3], "dropped": [0.5], "clock_jump": [3.0]}  # [s], share, [s].
KINDS = ("silent", "frozen", "nan", "biased", "drifting", "clock_jump")
WINDOWS = ("before", "while", "after")
LASTS = 3.0  # [s]
RECOVERY = 1.0  # [s]
_CERTAIN = 0.95
_REST = 0.02  # Share of the largest opening that is left when the motion is over.


@dataclass(frozen=True, kw_only=True)
class Case:
    """One fault of one stream at one time; no stream: nothing fails."""

    stream: str = ""
    kind: str = ""
    when: str = ""
    start: float = 0.0  # [s]
    end: float = float("inf")

    def fault(self, scale: float) -> StreamFault:
        own = SIZES[self.stream].get(self.kind)
        size = COMMON_SIZES.get(self.kind, []) if own is None else list(scale * np.array(own))
        return StreamFault(
            stream=self.stream, kind=self.kind, start=self.start, end=self.end, size=size
        )


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What came of a case; times [s], errors of the configuration [m or rad].

    Attributes:
        crash: What was raised, in a line.
        told_after: When the stream's monitor reported a fault, after its start and before its end.
        inside: Share of the claims from the fault on whose error is below three deviations.
        worst: Largest error over reported deviation from the fault on.
        recovered: Whether the truth was within two deviations 1 s after the end; None if the
            recording ended before, or nothing would be claimed then without a fault either.
    """

    case: Case
    crash: str | None = None
    told_after: float | None = None
    inside: float = float("nan")
    worst: float = float("nan")
    final_error: float = float("nan")
    final_std: float = float("nan")
    recovered: bool | None = None


def moving_times(truth: Truth) -> tuple[float, float]:
    """From when to when the object moves, [s]."""
    begins = motion_start(truth)
    if begins is None:
        raise ScenarioError("nothing moves in this recording, or what is true is not known")
    opening = np.abs(truth.opening())
    short = opening < (1.0 - _REST) * opening[truth.times >= begins].max()
    moving = np.flatnonzero((truth.times >= begins) & short)
    return begins, float(truth.times[moving[-1]])


def cases_of(
    truth: Truth, duration: float, streams: Sequence[str], kinds: Sequence[str]
) -> list[Case]:
    """All that may fail in a recording."""
    begins, ends = moving_times(truth)
    middle = 0.5 * (begins + ends - LASTS)
    starts = dict(zip(WINDOWS, (max(begins - LASTS, 0.0), middle, ends), strict=True))
    return [
        Case(stream=stream, kind=kind, when=when, start=start, end=min(start + LASTS, duration))
        for stream in streams
        for kind in kinds
        if (stream, kind) != ("color_measured", "nan")  # Its pixels are whole numbers.
        for when, start in starts.items()
    ]


def deviations(series: JointSeries) -> Array:
    """Error over reported deviation (T,), NaN where nothing is claimed.

    Of a joint type of another unit, infinite if it is claimed for certain, else no claim.
    """
    z = np.abs(series.error) / series.configuration_std
    for k, joint in enumerate(series.joints):
        if joint is not None and np.isfinite(series.configuration[k]) and np.isnan(z[k]):
            z[k] = np.inf if joint.probabilities[joint.type] > _CERTAIN else np.nan
    return z


def outcome(
    case: Case, record: EpisodeRecord, modality: str, healthy: Array | None = None
) -> Outcome:
    """What a replay came to.

    Args:
        healthy: `deviations` (T,) of the replay without a fault.
    """
    series: JointSeries = joint_episode(record).series[modality]
    z = deviations(series)
    known = np.flatnonzero(~np.isnan(z))
    claims = z[known[series.times[known] >= case.start]]
    name = STREAMS.get(case.stream)
    told = [s.start for s in fault_spans(record) if s.stream == name and s.start < case.end]
    later = np.flatnonzero(series.times >= case.end + RECOVERY - 1e-6)
    judged = len(later) and (healthy is None or not np.isnan(healthy[later[0]]))
    found = Outcome(
        case=case,
        told_after=min((start - case.start for start in told if start >= case.start), default=None),
        recovered=bool(z[later[0]] < 2.0) if judged else None,
    )
    if len(known):
        final_error, final_std = series.error[known[-1]], series.configuration_std[known[-1]]
        found = replace(found, final_error=float(final_error), final_std=float(final_std))
    if len(claims):
        inside = float(np.mean(claims < 3.0))
        found = replace(found, inside=inside, worst=float(claims.max()))
    return found


def try_case(
    application: Application,
    run: Path,
    scenario: Scenario,
    case: Case,
    scale: float,
    healthy: Array,
) -> Outcome:
    """The outcome of a case; whatever is raised is a crash, and one of the figures."""
    faults = [case.fault(scale)] if case.stream else []
    disturbances = replace(scenario.disturbances, faults=faults)
    modality = scenario.modalities[0]
    try:
        record = replay(application, run, replace(scenario, disturbances=disturbances))
        return outcome(case, record, modality, healthy)
    except Exception as error:
        crash = f"{type(error).__name__}: {error}".splitlines()[0]
        return Outcome(case=case, crash=crash, inside=0.0, recovered=False)


def read_outcomes(file: Path) -> list[Outcome]:
    """Those of earlier calls; a line that an interruption cut off is left out."""
    found = []
    for line in file.read_text().splitlines() if file.exists() else []:
        try:
            values: dict[str, Any] = json.loads(line)
        except ValueError:
            continue
        found.append(Outcome(**{**values, "case": Case(**values["case"])}))
    return found


def table_row(found: Outcome) -> str:
    """One line of the table; errors in mm or mrad."""
    case = found.case
    told = "no" if found.told_after is None else f"{found.told_after:.2f} s"
    cells = [STREAMS.get(case.stream, "none"), case.kind or "-", case.when or "-", told]
    if found.crash:
        return "| " + " | ".join([*cells, found.crash, "", "", ""]) + " |"
    recovered = {True: "yes", False: "**no**", None: "-"}[found.recovered]
    bold = "**" if not found.worst < 3.0 else ""
    cells += [
        f"{bold}{found.worst:.1f}{bold}",
        f"{100 * found.inside:.0f} %",
        f"{1e3 * found.final_error:.1f} ({1e3 * found.final_std:.1f})",
        recovered,
    ]
    return "| " + " | ".join(cells) + " |"


def share(flags: Iterable[bool]) -> str:
    found = list(flags)
    return f"{sum(found)} of {len(found)} ({100 * np.mean(found):.0f} %)" if found else "-"


def figures(found: list[Outcome]) -> list[str]:
    """The figures over all cases in which something fails, in words."""
    failing = [one for one in found if one.case.stream]
    told = [one.told_after if one.told_after is not None else np.inf for one in failing]
    plain = [one.case.kind not in ("biased", "drifting") for one in failing]
    inside = [one.inside for one in failing if np.isfinite(one.inside)]
    return [
        f"- crashed: {share(one.crash is not None for one in failing)}",
        f"- detected within 0.5 s: {share(t <= 0.5 for t in told)}; within 0.3 s:"
        f" {share(t <= 0.3 for t in told)}; of those that are neither biased nor drifting within"
        f" 0.3 s: {share(t <= 0.3 for t, p in zip(told, plain, strict=True) if p)}",
        f"- truth inside three reported deviations: {100 * np.mean(inside):.1f} % of all claims; in"
        f" at least 95 % of its claims: {share(x >= 0.95 for x in inside)} cases",
        "- within two reported deviations 1 s after recovery:"
        f" {share(one.recovered for one in failing if one.recovered is not None)}",
    ]


HEADER = (
    "| stream | fault | when | detected after | largest, in reported deviations | inside three "
    "| at the end (claimed), mm or mrad | recovered |"
)


def main(
    runs: Annotated[list[Path], typer.Argument(help="Folders of recorded runs.")],
    out: Annotated[Path, typer.Option(help="Folder of the outcomes.")] = Path("runs/faults"),
    modality: Annotated[str, typer.Option(help="Which network.")] = "crossmodal",
    streams: Annotated[str, typer.Option(help="Ports, with commas.")] = ",".join(STREAMS),
    kinds: Annotated[str, typer.Option(help="Faults, with commas.")] = ",".join(KINDS),
    scale: Annotated[float, typer.Option(help="Of the sizes of bias and drift.")] = 1.0,
) -> None:
    """Prints the table of each run, and the figures over all."""
    out.mkdir(parents=True, exist_ok=True)
    for run in runs:
        scenario_file = check_recorded(run)
        application, scenario = load_scenario(str(scenario_file), [f"modalities=[{modality}]"])
        file = out / f"{run.resolve().name}-{modality}-{scale:g}.jsonl"
        healthy = replay(application, run, scenario)
        episode = joint_episode(healthy)
        truth, usual = episode.truth, deviations(episode.series[modality])
        found = [outcome(Case(), healthy, modality)]
        known = {one.case: one for one in read_outcomes(file)}
        cases = cases_of(truth, healthy.duration, streams.split(","), kinds.split(","))
        with file.open("a") as log:
            for case in tqdm(cases, desc=run.name, unit="case", disable=None):
                if case not in known:
                    known[case] = try_case(application, run, scenario, case, scale, usual)
                    log.write(json.dumps(asdict(known[case])) + "\n")
                    log.flush()
                found.append(known[case])
        begins, ends = moving_times(truth)
        print(f"\n{scenario.name}, seed {scenario.seed}: moves from {begins:.1f} to {ends:.1f} s\n")
        print(HEADER + "\n|" + "---|" * HEADER.count(" | ") + "---|")
        print("\n".join(map(table_row, found)) + "\n")
        print("\n".join(figures(found)))


if __name__ == "__main__":
    typer.run(main)
