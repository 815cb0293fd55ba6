"""The figure of the tip on its line."""

from types import SimpleNamespace

import numpy as np
import pytest
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RigidTransform

from crossmodal.diagrams.flap.flip_status import DONE, FLIPPING, ON_LINE, TO_TABLE
from crossmodal.diagrams.flap.results.tip_line import tip_line
from crossmodal.diagrams.run.record import EpisodeRecord, EstimatorRecord, Event, TaskStatus, Tick

START, END = np.array([0.575, 0.05, 0.175]), np.array([0.425, 0.05, 0.175])
P_FT = np.array([0.002, 0.055, 0.0])  # Where the finger touched the edge.
OFF = np.array([0.0, 0.003, -0.004])  # Of the true tip from the line.
R_WE = RigidTransform(AngleAxis(0.7, np.array([0.0, 1.0, 0.0])), np.zeros(3))


P_ET = np.array([0.1, 0.0, 0.2])  # As the acting estimator has it.
L1 = np.array([0.0, 0.0, -0.2])
LINK = np.array([0.0, 0.0, 0.002])  # From where that puts the tip, in the world.


def station_tick(time, phase, p_WT, touching=False):
    """The flap so that its point T is at p_WT, turned a little more with time."""
    R = RigidTransform(AngleAxis(0.1 * time, np.array([0.0, 1.0, 0.0])), np.zeros(3)).rotation()
    X_WF = RigidTransform(R, p_WT - R @ P_FT)
    contact = SimpleNamespace(touching=touching, p_WC=p_WT if touching else np.full(3, np.nan))
    return Tick(
        time=time,
        values={
            "task_status": TaskStatus(phase=phase),
            "cheat_flap": contact,
            "cheat_edge_pose": X_WF,
            "cheat_end_effector_pose": RigidTransform(R_WE.rotation(), p_WT - LINK - R_WE @ P_ET),
            "tip_estimated": p_WT - OFF,
        },
    )


def record(last=DONE, higher=0.0):
    station = [
        station_tick(k, FLIPPING, np.array([0.5, 0.0, 0.6]), touching=True) for k in range(3)
    ]
    station.append(station_tick(3, TO_TABLE, np.array([0.6, 0.1, 0.3])))
    ways = np.linspace(0.0, 1.0, 11)
    station += [
        station_tick(4 + k, ON_LINE, START + s * (END - START) + OFF) for k, s in enumerate(ways)
    ]
    station.append(station_tick(15, last, END + np.array([0.0, 0.2, 0.0])))

    def believes(p_ET, L1_W):
        X_EK = np.eye(4)
        X_EK[:3, 3] = p_ET
        hinge = SimpleNamespace(p_WK=np.array([0.5, 0.0, 0.55]))
        tool = SimpleNamespace(hinge=hinge, L1_W=L1_W, X_EK=X_EK, X_KT=np.eye(4))
        return EstimatorRecord(
            ticks=[Tick(time=t.time, values={"tool_latest": tool}) for t in station]
        )

    # The other estimator takes the tip to be 3 mm along y of E and so would have put it 3 mm short.
    other = P_ET + np.array([0.0, 0.003, 0.0])
    return EpisodeRecord(
        scenario=SimpleNamespace(
            acting_estimator="geometric",
            control=SimpleNamespace(line=SimpleNamespace(start=START, end=END)),
        ),
        calibration=None,
        station=station,
        estimators={
            "geometric": believes(P_ET, L1),
            "filtered": believes(other, L1 + np.array([0.0, 0.0, higher])),
        },
        duration=15.0,
        wall_time=1.0,
        events=[Event(time=15.0, name=last)],
    )


def test_the_figure_is_the_distance_of_the_point_that_was_touched_from_the_line():
    line = tip_line(record())
    assert line.on_line.sum() == 11
    assert line.rms(line.p_WT) == pytest.approx(0.005)
    assert line.rms(line.p_WT_estimated) == pytest.approx(0.0, abs=1e-12)
    way, offset = line.offsets(line.p_WT[line.on_line])
    np.testing.assert_allclose(way, np.linspace(0.0, 0.15, 11), atol=1e-12)
    np.testing.assert_allclose(offset, np.tile(OFF, (11, 1)), atol=1e-12)


def test_the_other_estimator_is_judged_by_where_its_tip_would_have_been():
    line = tip_line(record())
    assert line.rms(line.p_WT_of("geometric")) == pytest.approx(0.005)
    assert line.rms(line.p_WT_of("filtered")) == pytest.approx(0.004)


def test_an_estimator_that_has_the_arm_elsewhere_would_have_put_the_tip_there_by_that():
    """It takes the arm to be 1 mm lower than the acting one does, and so would go 1 mm up."""
    line = tip_line(record(higher=0.001))
    p_WT = line.p_WT_of("filtered")[line.on_line]
    np.testing.assert_allclose(
        line.offsets(p_WT)[1], np.tile([0.0, 0.0, -0.003], (11, 1)), atol=1e-9
    )


def test_the_error_of_the_link_leaves_out_that_of_the_arm():
    line = tip_line(record())
    assert line.link_rms("geometric") == pytest.approx(0.002)
    assert line.link_rms("filtered") == pytest.approx(np.hypot(0.002, 0.003))


def test_a_line_that_was_not_finished_has_no_figure():
    line = tip_line(record(last="stopped"))
    assert np.isnan(line.rms(line.p_WT))
    assert np.isnan(line.rms(line.p_WT_of("filtered")))
    assert np.isnan(line.link_rms("geometric"))


def test_without_a_flip_there_is_no_tip():
    ended = record()
    ended.station[:] = [station_tick(0, "approaching", START)]
    ended.events[:] = []
    line = tip_line(ended)
    assert np.isnan(line.p_WT).all()
    assert np.isnan(line.rms(line.p_WT))
