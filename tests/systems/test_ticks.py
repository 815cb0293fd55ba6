"""Durations in seconds become numbers of ticks, at any period."""

from dataclasses import dataclass, field

import pytest

from crossmodal.maths.validation import number
from crossmodal.systems.shared_settings import with_shared
from crossmodal.systems.ticks import NETWORK_PERIOD, Ticked, require_ticks, whole_ticks
from crossmodal.systems.vision.bodies.body_tracker_state import no_bodies
from crossmodal.systems.vision.bodies.rigid_body_motion_config import RigidBodyMotionConfig
from crossmodal.systems.vision.features.feature_motion_config import FeatureMotionConfig
from crossmodal.systems.vision.features.feature_tracks import no_tracks

CAMERA_PERIOD = 1.0 / 30.0  # [s]


def test_a_duration_is_rounded_to_the_nearest_tick() -> None:
    assert whole_ticks(0.2, 1.0 / 15.0) == 3
    assert whole_ticks(0.2, CAMERA_PERIOD) == 6
    assert [whole_ticks(duration, 0.1) for duration in (0.0, 0.04, 0.06, 0.14)] == [0, 0, 1, 1]


def test_the_durations_of_the_body_tracker_last_as_long_at_another_period() -> None:
    config = RigidBodyMotionConfig()
    durations = {
        config.history.window: 30,
        config.history.newest: 3,
        config.history.memory: 45,
        config.history.rest_time: 60,
        config.history.nudge_time: 5,
        config.association.rejection_time: 8,
        config.association.free_rejection_time: 45,
        config.patience: 30,
        config.initial_patience: 5,
    }
    for duration, ticks in durations.items():
        assert whole_ticks(duration, config.period) == ticks
        assert whole_ticks(duration, CAMERA_PERIOD) == 2 * ticks
    assert no_bodies(config).history.p_W.shape[1] == 30
    assert no_bodies(with_shared(config, period=CAMERA_PERIOD)).history.p_W.shape[1] == 60


def test_the_durations_of_the_feature_tracker_last_as_long_at_another_period() -> None:
    config = FeatureMotionConfig()
    durations = {
        config.detection.interval: 2,
        config.registration.shape_interval: 3,
        config.tracks.tentative_age: 3,
        config.tracks.failure_pause: 60,
        config.tracks.max_missed: 15,
        config.tracks.max_blackout: 45,
    }
    for duration, ticks in durations.items():
        assert whole_ticks(duration, config.period) == ticks
        assert whole_ticks(duration, CAMERA_PERIOD) == 2 * ticks
    assert no_tracks(with_shared(config, period=CAMERA_PERIOD)).since_search == 4


@dataclass
class Durations:
    pause: float = number(1.0, above=0.0, at_most=10.0, unit="s")
    interval: float = number(0.1, above=0.0, at_most=10.0, unit="s")


@dataclass
class Config:
    search: Durations = field(default_factory=Durations)


def test_a_duration_of_too_few_ticks_is_refused_with_what_is_needed() -> None:
    require_ticks("System", Durations(), 0.1, lasting="pause interval")
    with pytest.raises(ValueError, match=r"System: interval = 0.1 s, need >= a tick, 0.5 s"):
        require_ticks("System", Durations(), 0.5, lasting="pause interval")
    with pytest.raises(ValueError, match=r"System: pause = 1.0 s, need >= 11 ticks, 1.1 s"):
        require_ticks("System", Durations(), 0.1, lasting="pause", least=11)
    with pytest.raises(ValueError, match=r"System: search\.interval = 0.1 s, need >= a tick"):
        require_ticks("System", Config(), 0.5, lasting="search.pause search.interval")


@dataclass(kw_only=True)
class Filter(Ticked):
    gain: float = 2.0


@dataclass(kw_only=True)
class Network:
    filter: Filter = field(default_factory=Filter)
    durations: Durations = field(default_factory=Durations)


def test_every_filter_gets_the_networks_period_and_the_given_one_stays_as_it_was() -> None:
    network = Network(filter=Filter(gain=3.0))
    ticked = with_shared(network, period=0.05)
    assert (ticked.filter.period, ticked.filter.gain) == (0.05, 3.0)
    assert network.filter.period == NETWORK_PERIOD
    assert not hasattr(ticked.durations, "period")
