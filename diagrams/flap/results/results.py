"""What an episode of the flap comes to."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import partial
from typing import Any

import numpy as np

from crossmodal.diagrams.drawing.digits import fixed, written
from crossmodal.diagrams.evaluation.estimates import Row, estimates_table, scalar, vector
from crossmodal.diagrams.evaluation.stream_faults import (
    fault_events,
    fault_lines,
    fault_spans,
    health_rows,
)
from crossmodal.diagrams.flap.estimator_names import LABELS
from crossmodal.diagrams.flap.results.flap_episode import FlapEpisode, TrueFlap, flap_episode
from crossmodal.diagrams.flap.results.flap_measures import (
    measure_estimation,
    measure_servoing,
    summarise_recoveries,
)
from crossmodal.diagrams.flap.results.task import can_be_judged, line_note, task_failure
from crossmodal.diagrams.run.application import Results
from crossmodal.diagrams.run.record import EpisodeRecord, Tick
from crossmodal.systems.port_values import UNKNOWN_ANGLE, UNKNOWN_FINGERTIP, FingertipContact


def evaluate(record: EpisodeRecord) -> Results:
    """Compares an episode's beliefs with the truth."""
    # What only shows is imported here, so that it does not belong to `program_files`.
    from crossmodal.diagrams.flap.results.frame_plots import draw_frames
    from crossmodal.diagrams.flap.results.plots import (
        draw_angle,
        draw_line,
        draw_servoing,
        draw_tool,
    )

    episode = flap_episode(record)
    scenario, truth = record.scenario, episode.truth
    servoing = measure_servoing(truth, scenario.control.force)
    judged = can_be_judged(truth)
    faults = fault_spans(record)
    return Results(
        failure=task_failure(scenario.task, record, servoing) if judged else None,
        judged=judged,
        estimates=estimates_table(
            {
                name: [(time, _rows(episode, name, k)) for k, time in enumerate(series.times)]
                for name, series in episode.series.items()
            }
        ),
        events=fault_events(faults),
        summary={
            "flap": {
                **asdict(servoing),
                **summarise_recoveries(truth, scenario.disturbances.jerks),
                "tip_line_rms": episode.line.rms(episode.line.p_WT),
                "line_note": line_note(record),
            },
            "stream_faults": [asdict(fault) for fault in faults],
            "modalities": {
                name: {
                    "flap": {
                        **asdict(measure_estimation(truth, series)),
                        "tip_line_rms": episode.line.rms(episode.line.p_WT_of(name)),
                        "tip_link_rms": episode.line.link_rms(name),
                    }
                }
                for name, series in episode.series.items()
            },
        },
        plots={
            "servoing.png": partial(draw_servoing, episode),
            "angle.png": partial(draw_angle, episode),
            "tool.png": partial(draw_tool, episode),
            "line.png": partial(draw_line, episode),
            "frames.png": partial(draw_frames, episode),
        },
        report=report,
    )


def _rows(episode: FlapEpisode, name: str, k: int) -> list[Row]:
    series, truth = episode.series[name], episode.truth
    rows: list[Row] = []
    if not np.isnan(series.theta[k]):
        rows.append(scalar("theta", series.theta[k], std=series.theta_std[k], true=truth.theta[k]))
    for quantity, value, covariance, true in (
        ("axis", series.k_W, series.k_covariance, truth.k_W),
        ("L1", series.L1_W, series.L1_covariance, truth.L1_W),
        ("L2", series.L2_W, series.L2_covariance, truth.L2_W),
    ):
        if not np.isnan(value[k]).any():
            rows += vector(quantity, value[k], covariance[k], true[k])
    rows.append(scalar("flap_seen", float(series.seen[k])))
    tick = episode.record.estimators[name].ticks[k]
    return rows + _contact_rows(tick, truth, k) + health_rows(tick)


def _contact_rows(tick: Tick, truth: TrueFlap, k: int) -> list[Row]:
    """What the fingertip feels: where the contact is on it, its force, and the pad's normal."""
    finger: FingertipContact = tick.values.get("fingertip_contact_latest", UNKNOWN_FINGERTIP)
    contact, rows = finger.contact, list[Row]()
    if contact.touching:
        rows += vector("contact_position", contact.p_SC, contact.covariance, truth.p_SC[k])
        rows.append(scalar("contact_force", contact.force, true=truth.force[k]))
    n_W = tick.values.get("flap_angle_latest", UNKNOWN_ANGLE).n_W
    if np.isfinite(n_W).all():
        out_of_flap = (finger.X_WS[:3, 1] @ n_W, truth.Sy_W[k] @ truth.n_W[k])
        found, true = np.arcsin(np.clip(out_of_flap, -1.0, 1.0))
        rows.append(scalar("pad_out_of_flap", found, true=true))
    return rows


_LINES: Sequence[tuple[str, str, float, str]] = (
    ("axis_angle_error", "axis after 30 deg", 180.0 / np.pi, "deg"),
    ("theta_rmse_visible", "angle, RMS while seen", 180.0 / np.pi, "deg"),
    ("theta_rmse_hidden", "angle, RMS while hidden", 180.0 / np.pi, "deg"),
    ("L1_error", "L1, mean error", 1e3, "mm"),
    ("L2_error", "L2, mean error", 1e3, "mm"),
    ("tip_line_rms", "tip from its line, RMS", 1e3, "mm"),
    ("tip_link_rms", "of that by the tool alone", 1e3, "mm"),
)


def _recovery_line(jerk: Mapping[str, Any]) -> str:
    """What a jerk of the flap came to, in words."""
    way, after = jerk["displacement"], jerk["reestablished_after"]
    moved = f"Jerked by {written(None if way is None else 1e3 * way, 'mm')}"
    if not jerk["contact_lost"]:
        what = "the contact was kept"
    elif after is None or np.isnan(after):
        what = "the contact was lost and not found again"
    else:
        what = f"the contact was lost and found again after {written(after, 's')}"
    return f"{moved} at {jerk['start']:.1f} s: {what}."


def report(summary: Mapping[str, Any]) -> list[str]:
    """What the fingertip did and how well the tool is known, in words."""
    flap = summary["flap"]

    def value(key: str, scale: float, unit: str) -> str:
        return written(None if flap[key] is None else scale * flap[key], unit)

    lines = [
        f"Flap turned by {value('turned', 180.0 / np.pi, 'deg')}, at most"
        f" {value('longest_loss', 1.0, 's')} without contact;",
        f"contact on the fingertip {value('contact_position_rms', 1e3, 'mm')} RMS about"
        f" {value('contact_position_offset', 1e3, 'mm')} along x,"
        f" force {value('force_rms', 1.0, 'N')} RMS off;",
        f"it slides along the edge by {value('edge_slide', 1e3, 'mm')}, friction along the edge"
        f" {value('edge_force', 1.0, 'N')} RMS;",
        f"the pad's normal is {value('misaligned_at_first', 180.0 / np.pi, 'deg')} out of the flap"
        f" at first, and in it after {value('aligned_after', 1.0, 's')}.",
        *(_recovery_line(jerk) for jerk in flap.get("jerks", [])),
        "",
        "The tool, against the truth:",
    ]
    for name, record in summary["modalities"].items():
        found = record["flap"]
        parts = [
            f"{title} {written(None if found[key] is None else scale * found[key], unit)}"
            for key, title, scale, unit in _LINES
        ]
        shares = "/".join(
            "-" if share is None or np.isnan(share) else fixed(100.0 * share, 0)
            for share in found["inside_two_sigma"].values()
        )
        lines.append(f"  {LABELS.get(name, name)}: " + ", ".join(parts))
        lines.append(f"    inside 2σ (axis/angle/L1/L2): {shares} % of the ticks")
    if flap["line_note"]:
        lines.append(f"No line: {flap['line_note']}.")
    if faults := fault_lines(summary["stream_faults"]):
        lines += ["", "Streams that were not trusted:"] + [f"  {line}" for line in faults]
    return lines
