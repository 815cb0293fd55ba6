"""The mask of a robot in a recording without one: its model at the measured joints."""

from pathlib import Path
from typing import Any

import numpy as np

from crossmodal.diagrams.applications import load_scenario
from crossmodal.diagrams.recordings.export_bag import export_bag
from crossmodal.diagrams.recordings.port_sources import SpanSource
from crossmodal.diagrams.recordings.robot_mask_source import RenderedMaskSource
from crossmodal.diagrams.recordings.sample_rows import JointRows
from crossmodal.diagrams.run.replay import check_recorded
from crossmodal.systems.recordings.images import color_of
from crossmodal.systems.recordings.open_recording import open_recording

RUN = Path(__file__).parents[2] / "recordings/drawer"
JOINTS, MASK, HELD = "/joint_states", "/camera/robot_mask", "/hand/interaction_active"


def test_it_is_the_mask_that_was_recorded_beside_the_joints(tmp_path: Path) -> None:
    last: dict[str, tuple[int, Any]] = {}
    with open_recording(export_bag(RUN, tmp_path / "drawer.bag", "bag")) as recording:
        for logged in recording.messages([JOINTS, MASK, HELD]):
            last[logged.topic] = logged.time, logged.decode()
    application, scenario = load_scenario(str(check_recorded(RUN)))
    calibration = application.make_calibration(scenario)
    is_held = bool(np.ravel(last[HELD][1].data)[0] > 0.5)
    source = RenderedMaskSource(
        JointRows(JOINTS, [], 7), JOINTS, calibration, SpanSource(lambda time: is_held)
    )
    assert not source.value(0).data.any()  # Nothing is known of the joints yet.
    source.add(JOINTS, 1, last[JOINTS][1])
    found = source.value(2).data[:, :, 0] > 0
    recorded = color_of(last[MASK][1])[:, :, 0] > 0
    assert recorded.sum() > 1000
    assert (found & recorded).sum() > 0.97 * (found | recorded).sum()
    assert source.value(3).data[:, :, 0].astype(bool).sum() == found.sum()  # No newer state.
