"""Buttons of the live page: pause, single tick, end, next seed, what is shown."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from pydrake.geometry import Meshcat

from crossmodal.diagrams.drawing.layers import Layers
from crossmodal.diagrams.run.live.controls import Control, page_name

PAUSE, TICK, END, NEXT = "Pause / go on", "Single tick", "End the episode", "Restart, next seed"
TRUTH = "Truth: show / hide"
_POLLING = 0.05  # Between two looks at the buttons while it is paused, [s].


@dataclass(kw_only=True)
class LiveSession:
    """What a person at the page asks of an episode.

    Attributes:
        meshcat: The page.
        layers: What can be shown and hidden.
        shown: The estimator whose beliefs are visible.
        shows_truth: Whether the truth is visible.
        controls: Sliders.
        wants_next: Whether the next seed is asked for.
        is_paused: Whether it waits.
        waited: How long it has waited so far, [s].
    """

    meshcat: Meshcat
    layers: Layers = field(default_factory=Layers)
    shown: str = ""
    shows_truth: bool = False
    controls: Sequence[Control] = ()
    wants_next: bool = False
    is_paused: bool = False
    waited: float = 0.0
    _ticks: int = 0
    _seen: dict[str, int] = field(default_factory=dict)
    _values: dict[str, float] = field(default_factory=dict)  # Of the sliders, at the last tick.
    _noted: dict[str, float] = field(default_factory=dict)  # Those that are known.

    def __post_init__(self) -> None:
        self.meshcat.DeleteAddedControls()
        for name, key in ((PAUSE, "Space"), (TICK, "KeyT"), (END, ""), (NEXT, "KeyN")):
            self._add_button(name, key)
        for name in self._switches():
            self._add_button(name, "")
        self._noted = {control.name: control.value for control in self.controls}
        for control in self.controls:
            self.meshcat.AddSlider(
                control.page_name, control.low, control.high, control.step, control.value
            )

    def _add_button(self, name: str, key: str) -> None:
        self.meshcat.AddButton(page_name(name), key)
        self._seen[name] = self.meshcat.GetButtonClicks(page_name(name))

    def _switches(self) -> list[str]:
        """Buttons that say what is shown; there is no choice among one estimator."""
        estimators = self.layers.estimators if len(self.layers.estimators) > 1 else ()
        return [*(f"Show {name}" for name in estimators), *([TRUTH] if self.layers.truth else [])]

    def _clicks(self, name: str) -> int:
        """How often a button was pressed since it was asked last."""
        if name not in self._seen:
            return 0
        count = self.meshcat.GetButtonClicks(page_name(name))
        new, self._seen[name] = count - self._seen[name], count
        return new

    def between_ticks(self) -> None:
        """Does what was asked for; waits while the episode is paused.

        Raises:
            KeyboardInterrupt: when the episode is to end.
        """
        while True:
            self._show()
            if self._clicks(NEXT):
                self.wants_next = True
            if self.wants_next or self._clicks(END):
                raise KeyboardInterrupt
            if self._clicks(PAUSE) % 2:
                self.is_paused = not self.is_paused
            ticks = self._clicks(TICK)
            self.is_paused |= ticks > 0
            self._ticks += ticks
            if not self.is_paused:
                return
            if self._ticks:
                self._ticks -= 1
                return
            time.sleep(_POLLING)
            self.waited += _POLLING

    def _show(self) -> None:
        for name in self.layers.estimators:
            if self._clicks(f"Show {name}") and name != self.shown:
                self.shown = name
                for other, path in self.layers.estimators.items():
                    self.meshcat.SetProperty(path, "visible", other == name)
        if self._clicks(TRUTH) % 2:
            self.shows_truth = not self.shows_truth
            self.meshcat.SetProperty(self.layers.truth, "visible", self.shows_truth)

    def changes(self) -> list[str]:
        """What was changed by sliders that have come to rest since it was asked last."""
        found = []
        for control in self.controls:
            value = self.meshcat.GetSliderValue(control.page_name)
            rests = value == self._values.get(control.name)
            if rests and value != self._noted[control.name]:
                self._noted[control.name] = value
                found.append(control.written(value))
            self._values[control.name] = value
        return found

    def close(self) -> None:
        """Takes buttons and sliders off the page that would act on nothing any more.

        What is shown can still be chosen by Meshcat's own controls, and the next seed be asked for.
        """
        for name in (PAUSE, TICK, END, *self._switches()):
            self.meshcat.DeleteButton(page_name(name))
        for control in self.controls:
            self.meshcat.DeleteSlider(control.page_name)


def stay(meshcat: Meshcat, is_over: Callable[[], bool]) -> bool:
    """Keeps the page of an episode that has ended; returns whether the next seed is asked for.

    Args:
        meshcat: The page.
        is_over: Whether the person at the terminal has had enough.
    """
    # The session began with a new button and ended the episode at its first click: whatever it
    # counts now came afterwards, maybe while the results were written.
    try:
        while not meshcat.GetButtonClicks(NEXT):
            if is_over():
                return False
            time.sleep(_POLLING)
    except KeyboardInterrupt:
        return False
    return True
