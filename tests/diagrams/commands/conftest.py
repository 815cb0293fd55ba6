"""Commands are tested in an empty folder and without simulating."""

import os
import signal
import sys
import types
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from synthetic_episode import synthetic_episode

from diagrams.crossmodal.scenario import Scenario

Progress = Callable[[float], None] | None


@pytest.fixture(autouse=True)
def work_in_an_empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def fake_episode(monkeypatch: pytest.MonkeyPatch) -> types.SimpleNamespace:
    """Replaces the simulation by a synthetic episode; its attributes say how that ends."""
    fake = types.SimpleNamespace(
        failure=None, interrupt=False, error=None, stops_early=False, runs=[]
    )

    def run_episode(
        scenario: Scenario,
        seed: int,
        *,
        meshcat: Any = None,
        progress: Progress = None,
        sensors_file: Path | None = None,
    ) -> Any:
        fake.runs.append((scenario.name, seed, meshcat is not None))
        result = synthetic_episode(seed=seed)
        result.scenario, result.failure = scenario, fake.failure
        result.interrupted = fake.stops_early
        if fake.error is not None:
            raise fake.error
        if progress is not None:
            progress(1.0)
            if fake.interrupt:
                os.kill(os.getpid(), signal.SIGINT)
                try:
                    progress(2.0)
                except KeyboardInterrupt:
                    result.interrupted = True
        return result

    module = types.ModuleType("diagrams.run.episode")
    module.run_episode = run_episode  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "diagrams.run.episode", module)
    return fake
