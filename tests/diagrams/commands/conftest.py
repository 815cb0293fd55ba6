"""Commands are tested in an empty folder and without simulating."""

import os
import signal
import types
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from synthetic_episode import synthetic_episode

from crossmodal.diagrams.run.application import Application
from crossmodal.diagrams.run.record import EpisodeRecord
from crossmodal.diagrams.run.scenario import Scenario

Progress = Callable[[float], None] | None


@pytest.fixture(autouse=True)
def work_in_an_empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def fake_episode(monkeypatch: pytest.MonkeyPatch) -> types.SimpleNamespace:
    """Replaces the simulation by a synthetic episode; its attributes say how that ends.

    The drawer is open by the 20 cm asked for after 14 s.
    """
    fake = types.SimpleNamespace(
        duration=16.0, interrupt=False, error=None, stops_early=False, warning="", runs=[]
    )

    def run_episode(
        application: Application,
        scenario: Scenario,
        *,
        meshcat: Any = None,
        progress: Progress = None,
        sensors_file: Path | None = None,
        is_live: bool = False,
        sink: Any = None,
        begins_paused: bool = False,
        video_file: Path | None = None,
    ) -> EpisodeRecord:
        import warnings

        from crossmodal.diagrams.run.build import StationWarning

        fake.runs.append((scenario.name, scenario.seed, meshcat is not None))
        if fake.warning:
            warnings.warn(fake.warning, StationWarning, stacklevel=2)
        record = synthetic_episode(seed=scenario.seed, duration=fake.duration)
        record.scenario = scenario
        record.interrupted = fake.stops_early
        if fake.error is not None:
            raise fake.error
        if progress is not None:
            progress(1.0)
            if fake.interrupt:
                os.kill(os.getpid(), signal.SIGINT)
                try:
                    progress(2.0)
                except KeyboardInterrupt:
                    record.interrupted = True
        return record

    monkeypatch.setattr("crossmodal.diagrams.run.episode.run_episode", run_episode)
    return fake
