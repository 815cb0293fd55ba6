"""What counts as a flipped flap, and why an episode failed."""

import numpy as np

from crossmodal.diagrams.flap.results.flap_episode import TrueFlap
from crossmodal.diagrams.flap.results.flap_measures import Servoing
from crossmodal.diagrams.flap.results.tip_line import line_finished
from crossmodal.diagrams.flap.scenario import Scenario, Task
from crossmodal.diagrams.run.record import EpisodeRecord
from crossmodal.diagrams.run.recorder import STATUS_PORT


def can_be_judged(truth: TrueFlap) -> bool:
    """Whether a record holds what a verdict needs."""
    return bool(np.isfinite(truth.theta).any())


def task_failure(task: Task, record: EpisodeRecord, servoing: Servoing) -> str | None:
    """Why the flap was not flipped as it was to be, in one line; None where it was."""
    turned, asked = np.rad2deg(servoing.turned), np.rad2deg(task.least_angle)
    status = record.station_values(STATUS_PORT)
    note = status[-1].note if status else ""
    after = f"; the robot: {note}" if note else ""
    if np.isnan(servoing.longest_loss):
        return f"the fingertip never began to turn the flap{after}"
    if servoing.turned < task.least_angle:
        return f"the flap was turned by {turned:.1f} deg of the {asked:.3g} deg asked for{after}"
    if servoing.longest_loss > task.longest_loss:
        return (
            f"without contact for {servoing.longest_loss:.2f} s while turning the flap,"
            f" {task.longest_loss:.3g} s is allowed{after}"
        )
    if note:
        return f"the robot gave up: {note}"
    return None


def line_note(record: EpisodeRecord) -> str:
    """Why the tip did not follow its line to the end, in one line; empty where it did."""
    status = record.station_values(STATUS_PORT)
    if not status or line_finished(record):
        return ""
    return status[-1].note or "the episode ended before the tip had come to the line's end"


def task_in_words(scenario: Scenario) -> str:
    """What counts as done, with its tolerances."""
    task = scenario.task
    return (
        f"Done: the flap has truly been turned by {np.rad2deg(task.least_angle):.3g} deg or more,"
        f" never without contact for more than {task.longest_loss:.3g} s. The line on the table"
        " that follows is a figure of its own."
    )
