"""What `crossmodal inspect` shows of a model: a report, a picture, a command line."""

import shlex
import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from crossmodal.diagrams.crossmodal.inspection.report import report
from crossmodal.diagrams.crossmodal.objects.object_import import (
    WIDEST_PULL,
    PlaceWarning,
    imported,
    in_words,
    pull_error,
)
from crossmodal.diagrams.crossmodal.objects.object_model import read_object_model
from crossmodal.diagrams.crossmodal.own_object import own_object_assignments
from crossmodal.diagrams.crossmodal.scenario import Scenario
from crossmodal.diagrams.run.own_object import OwnObject
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError
from crossmodal.plants.object_import.inspection import inspect_model

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def inspected(
    own: OwnObject, scenario: str, load: Callable[[Sequence[str]], object]
) -> "tuple[list[str], Figure | None]":
    """The lines to print, and the picture; None where there is nothing to grasp.

    Args:
        own: The model; without a grasped frame its first handle is taken.
        scenario: Name of that in which its object takes the place of the scenario's.
        load: Loads it with assignments.

    Raises:
        ScenarioError: for what cannot be read.
    """
    try:
        found = inspect_model(own.model, scale=own.scale)
    except ValueError as error:
        raise ScenarioError(str(error)) from None
    lines = report(found, own.model)
    held = [handle.grasp_frame for handle in found.handles if not handle.faults]
    frames = [own.grasp_frame] if own.grasp_frame else held
    notes = ["Notes", *(f"  {text}" for text in found.warnings)] if found.warnings else []
    if not frames:
        return lines + notes, None
    base = load([])
    if not isinstance(base, Scenario):
        raise ScenarioError(
            f"--scenario {scenario}: inspect is for scenarios whose object is grasped and opened,"
            f" such as drawer; `crossmodal run {scenario} --object FILE` tries a model there"
        )
    lines.append("Place")
    for frame in frames:
        try:
            tried, chosen = _placed(own, frame, base, scenario, load, lines)
        except ScenarioError as error:
            if own.grasp_frame:
                raise
            lines.append(f"  {frame}: {error}")
        else:
            return _shown(tried, chosen, scenario, lines)  # Loading it has said the notes.
    return lines + notes, None


def _placed(
    own: OwnObject,
    frame: str,
    base: Scenario,
    scenario: str,
    load: Callable[[Sequence[str]], object],
    lines: list[str],
) -> tuple[OwnObject, Scenario]:
    """The model grasped at a frame, and the scenario with it; where it stands goes to `lines`."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        own = replace(own, grasp_frame=frame)
        if not own.pull_direction:
            own.pull_direction = _pull_as_it_opens(own, base, scenario)
        chosen = load(own_object_assignments(base, scenario, own))
    assert isinstance(chosen, Scenario)
    said = [str(one.message) for one in caught if issubclass(one.category, PlaceWarning)]
    where = "as given" if own.pose else "where the scenario's own object stands"
    lines.append(f"  {frame}: {said[0] if said else where}")
    for one in caught:
        if not issubclass(one.category, PlaceWarning):
            warnings.warn_explicit(one.message, one.category, one.filename, one.lineno)
    return own, chosen


def _shown(
    own: OwnObject, chosen: Scenario, scenario: str, lines: list[str]
) -> "tuple[list[str], Figure]":
    """The lines with the command that runs it, and the picture."""
    from crossmodal.diagrams.crossmodal.inspection.picture import picture

    words = ["crossmodal", "run", scenario, "--object", str(own.model)]
    for name, value in (
        ("--grasp-frame", own.grasp_frame),
        ("--joint", own.joint),
        ("--pull-direction", own.pull_direction),
        ("--object-pose", own.pose),
        ("--scale", "" if own.scale == 1.0 else f"{own.scale:g}"),
    ):
        words += [name, value] if value else []
    lines += ["Run it", f"  {shlex.join(words)}"]
    return lines, picture(chosen, f"{own.model.name}, grasped at {own.grasp_frame}")


def _pull_as_it_opens(own: OwnObject, base: Scenario, source: str) -> str:
    """The way that the joint lets the handle go, where the usual pull would not; else nothing."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # They are shown when the chosen one is loaded.
        made = imported(
            own.model,
            joint=own.joint,
            frame=own.grasp_frame,
            free=base.object.free,
            scale=own.scale,
            source="--object",
        )
    facts = read_object_model(
        made.model, joint=made.joint, frame=made.grasp_frame, source="--object"
    )
    if pull_error(facts, np.array([1.0, 0.0, 0.0])) <= WIDEST_PULL:
        return ""
    return in_words(facts.way_H)
