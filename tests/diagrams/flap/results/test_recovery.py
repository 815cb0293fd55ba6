"""Whether a contact that was jerked away came back."""

from dataclasses import replace

import numpy as np
import pytest

from crossmodal.diagrams.flap.results.flap_episode import TrueFlap
from crossmodal.diagrams.flap.results.recovery import recovery, summarise_recoveries
from crossmodal.plants.tools.flap_jerk import FlapJerk

TIMES = np.arange(300) / 15.0
JERK = FlapJerk(start=4.99, end=5.3)


def touched_but(*gaps: tuple[float, float]):
    """A flap that is jerked by 30 mm at 5 s and not touched in some intervals, [s]."""
    touching = np.ones(len(TIMES), bool)
    for start, end in gaps:
        touching &= (start > TIMES) | (end <= TIMES)
    unknown = np.full((len(TIMES), 3), np.nan)
    return TrueFlap(
        times=TIMES,
        theta=np.where(TIMES < 5.0, 0.5, 0.5 + 0.03 / 0.08),
        k_W=unknown,
        p_WK=np.tile([0.5, 0.0, 0.4], (len(TIMES), 1)),
        n_W=unknown,
        touching=touching,
        p_WC=np.where(touching[:, None], [0.5, 0.0, 0.32], np.nan),
        p_SC=unknown,
        n_W_contact=unknown,
        force=np.where(touching, 0.5, 0.0),
        p_WE=unknown,
        flipping=np.ones(len(TIMES), bool),
    )


def test_a_contact_that_came_back_is_timed_from_the_jerk() -> None:
    found = recovery(touched_but((5.2, 8.0)), JERK)
    assert found is not None
    assert found["contact_lost"]
    assert found["displacement"] == pytest.approx(0.03)
    assert found["reestablished_after"] == pytest.approx(3.01, abs=0.04)


def test_a_short_touch_is_no_contact() -> None:
    found = recovery(touched_but((5.2, 8.0), (8.3, 11.0)), JERK)
    assert found is not None
    assert found["reestablished_after"] == pytest.approx(6.01, abs=0.04)


def test_a_contact_that_never_came_back_has_no_time() -> None:
    truth = touched_but((5.2, 30.0))
    assert np.isnan(recovery(truth, JERK)["reestablished_after"])
    assert summarise_recoveries(truth, [JERK])["contact_reestablished"] is False


def test_a_contact_that_was_kept_was_not_lost() -> None:
    found = recovery(touched_but(), JERK)
    assert found is not None
    assert not found["contact_lost"]
    assert found["reestablished_after"] == 0.0


def test_a_finger_that_retreats_has_not_lost_the_contact() -> None:
    truth = replace(touched_but((15.0, 30.0)), retreated_at=15.0)
    found = recovery(truth, JERK)
    assert found is not None
    assert not found["contact_lost"]
    lost = replace(touched_but((5.2, 14.5), (15.0, 30.0)), retreated_at=15.0)
    assert np.isnan(recovery(lost, JERK)["reestablished_after"])
    assert recovery(truth, FlapJerk(start=16.0, end=16.3)) is None


def test_an_episode_that_ends_before_the_jerk_shows_nothing() -> None:
    late = FlapJerk(start=100.0, end=100.3)
    assert recovery(touched_but(), late) is None
    assert summarise_recoveries(touched_but(), [late])["contact_reestablished"] is False
    assert summarise_recoveries(touched_but(), []) == {}
