"""The matrix of faults: that all of its cases can happen, and what it makes of them."""

import json
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from pydrake.systems.sensors import ImageDepth32F, ImageRgba8U

from benchmarks.fault_matrix import (
    COMMON_SIZES,
    KINDS,
    SIZES,
    STREAMS,
    Case,
    Outcome,
    figures,
    read_outcomes,
)
from crossmodal.systems.port_values import SampleWindow, StampedImage
from crossmodal.systems.sensors.stream_fault import FAULTS, check_fault

LENGTHS = {"joint_state_window": 14, "wrench_window": 6, "pressure_window": 4}
HEALTHY = Outcome(
    case=Case(stream="wrench_window", kind="silent", when="while", start=1.0, end=4.0),
    told_after=0.2,
    inside=1.0,
    worst=2.0,
    final_error=0.0,
    final_std=1.0,
    recovered=True,
)


def model(stream: str) -> object:
    if stream in LENGTHS:
        return SampleWindow(times=np.zeros(0), values=np.zeros((0, LENGTHS[stream])))
    kind = ImageRgba8U if stream.startswith("color") else ImageDepth32F
    return StampedImage(time=0.0, image=kind(4, 3))


@pytest.mark.parametrize("stream", STREAMS)
def test_every_fault_of_the_matrix_can_happen_to_its_stream(stream: str) -> None:
    assert set(KINDS) | set(COMMON_SIZES) <= set(FAULTS)
    assert set(SIZES[stream]) == {"biased", "drifting"}
    for kind in (*KINDS, *COMMON_SIZES):
        if (stream, kind) != ("color_measured", "nan"):
            case = Case(stream=stream, kind=kind, start=1.0, end=4.0)
            check_fault(case.fault(1.0), model(stream))


def test_what_was_found_is_read_again_without_the_line_that_was_cut_off(tmp_path: Path) -> None:
    file = tmp_path / "outcomes.jsonl"
    line = json.dumps(asdict(HEALTHY))
    file.write_text(f"{line}\n{line[:40]}")
    assert read_outcomes(file) == [HEALTHY]
    assert read_outcomes(tmp_path / "none") == []


def test_the_figures_count_what_crashed_was_told_late_or_claimed_too_much() -> None:
    wrong = replace(
        HEALTHY, crash="ValueError: x", told_after=None, inside=0.5, worst=np.inf, recovered=False
    )
    lines = figures([replace(HEALTHY, case=Case()), HEALTHY, wrong])
    assert "crashed: 1 of 2" in lines[0]
    assert "within 0.5 s: 1 of 2" in lines[1]
    assert "75.0 %" in lines[2]
    assert "1 of 2 (50 %)" in lines[3]
