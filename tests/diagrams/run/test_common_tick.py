"""One tick for all parts of a configuration."""

from dataclasses import dataclass, field

import pytest

from crossmodal.diagrams.run.common_tick import with_common_tick
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError


@dataclass(kw_only=True)
class Part:
    tick: float = 0.1
    gain: float = 2.0


@dataclass(kw_only=True)
class Whole:
    camera: Part = field(default_factory=Part)
    cut: list[str] = field(default_factory=list)


def test_every_part_gets_the_tick_and_the_given_one_stays_as_it_was() -> None:
    whole = Whole(camera=Part(gain=3.0))
    spread = with_common_tick(whole, ("tick",), 0.05, "my.yaml: sensors")
    assert spread == Whole(camera=Part(tick=0.05, gain=3.0))
    assert whole.camera.tick == 0.1


def test_a_part_with_another_tick_is_refused_by_its_name() -> None:
    whole = Whole(camera=Part(tick=0.2))
    with pytest.raises(ScenarioError, match=r"^my.yaml: sensors.camera.tick = 0.2 s, but all"):
        with_common_tick(whole, ("tick",), 0.05, "my.yaml: sensors")
