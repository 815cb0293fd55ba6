"""How an object is taken away: the numbers, the phases, and how it ended."""

from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from crossmodal.controllers.primitives.arm_task import TransitConfig
from crossmodal.maths.arrays import Array, unknown
from crossmodal.maths.immutable import Immutable
from crossmodal.maths.validation import number


@dataclass(kw_only=True)
class GripConfig:
    """How two fingers hold something."""

    # Of a finger that opens or closes.
    finger_speed: float = number(0.1, above=0.0, at_most=1.0, unit="m/s")
    # Of a finger's drive.
    stiffness: float = number(2000.0, above=0.0, at_most=1e6, unit="N/m")
    # Normal force of a finger with which it holds.
    force: float = number(5.0, above=0.0, at_most=100.0, unit="N")
    # Largest normal force of a finger. One whose drive needs it has met something: it is more
    # than what moves it at its speed, 6 N.
    largest_force: float = number(9.0, above=0.0, at_most=100.0, unit="N")
    # Of a finger: it has met something. The sum over its taxels has a noise of .05 N.
    contact: float = number(0.3, above=0.0, at_most=10.0, unit="N")
    # Shear over normal that is held; friction between fingers and goods is .53 and more.
    load: float = number(0.4, above=0.0, at_most=2.0)
    # At the largest force, this much slips, or is about to.
    largest_load: float = number(0.5, above=0.0, at_most=2.0)
    # Between the fingers: less is nothing.
    least_width: float = number(0.003, above=0.0, at_most=0.1, unit="m")
    # In which the force is reached once both fingers have met something.
    settling: float = number(0.4, above=0.0, at_most=60.0, unit="s")


@dataclass(kw_only=True)
class MoveObjectConfig:
    """How an arm grasps or pushes what stands on a table."""

    period: float = number(0.005, at_least=1e-4, at_most=1.0, unit="s")  # Between decisions.
    # Of a push, and of what is put down.
    speed: float = number(0.05, above=0.0, at_most=1.0, unit="m/s")
    # Of the open gripper as it comes down.
    descent_speed: float = number(0.1, above=0.0, at_most=1.0, unit="m/s")
    # With an object in the gripper.
    carry_speed: float = number(0.2, above=0.0, at_most=1.0, unit="m/s")
    transit: TransitConfig = field(default_factory=lambda: TransitConfig(speed=0.4))
    grip: GripConfig = field(default_factory=GripConfig)
    # By which the fingers' ends are below an object's top at least, to grasp it.
    grasped: float = number(0.02, above=0.0, at_most=0.5, unit="m")
    # Above the object's top the straight way down begins.
    above: float = number(0.03, at_least=0.0, at_most=0.5, unit="m")
    # What is carried is lifted by so much at least.
    lift: float = number(0.1, above=0.0, at_most=1.0, unit="m")
    # Force at which a push stops, as something is in its way, if it lasts: light things bounce.
    largest_push: float = number(8.0, above=0.0, at_most=100.0, unit="N")
    # For which the force has to last that stops a push. Two samples at 40 Hz.
    impact: float = number(0.05, at_least=0.0, at_most=1.0, unit="s")
    # By which the hand may be behind its command; taxels may not feel what holds it up.
    largest_lag: float = number(0.015, above=0.0, at_most=1.0, unit="m")
    # Least distance of the gripper from what stands around while it comes down between objects.
    near: float = number(0.002, at_least=0.0, at_most=0.1, unit="m")
    # Of the force on a taxel at the fingers' ends on the way down, beyond which it is blocked.
    threshold: float = number(0.08, above=0.0, at_most=100.0, unit="N")
    # By which the fingers go up again once they have met the table: as long as they press on it
    # they do not close on what is thin. The command is ahead of the hand by some millimetres.
    relief: float = number(0.004, at_least=0.0, at_most=0.05, unit="m")
    # For which the taxels' offsets are averaged.
    tare_time: float = number(0.5, above=0.0, at_most=60.0, unit="s")
    # Over which forces are averaged: of a decision.
    averaged: float = number(0.02, above=0.0, at_most=1.0, unit="s")
    # Over which forces are averaged: of a contact that is pushed.
    pushed_averaged: float = number(0.25, above=0.0, at_most=5.0, unit="s")
    # Of the way, along which it may not be felt: what slides ahead is met again by then, or lost.
    unfelt: float = number(0.04, at_least=0.0, at_most=0.5, unit="m")
    # What is felt of a push is so many standard deviations of its noise.
    significance: float = number(4.0, above=0.0, at_most=100.0)


class ActionPhase(StrEnum):
    """What the arm does."""

    WAIT = ""
    TARE = "takes the taxels' offsets"
    TRANSIT = "moves to the object"
    DESCEND = "comes down"
    CLOSE = "closes the gripper"
    LIFT = "lifts the object"
    CARRY = "carries the object"
    LOWER = "puts the object down"
    OPEN = "opens the gripper"
    PUSH = "pushes the object"
    RETREAT = "retreats"


class ActionOutcome(StrEnum):
    """How an action ended."""

    NONE = ""
    PLACED = "placed"
    SLIPPED = "slipped"
    PUSHED = "pushed"
    LOST = "lost"
    MISSED = "missed"
    BLOCKED = "blocked"
    UNREACHABLE = "unreachable"


@dataclass(frozen=True, kw_only=True)
class ActionEnd(Immutable):
    """How the last action ended.

    Attributes:
        number: Of the request; zero before the first one.
        outcome: `placed` or `pushed`; `slipped`, where it was held and is not any more or cannot be
            held safely; `lost`, where a push lost its contact; `missed`, where there was nothing;
            `blocked`, where something else was in the way; `unreachable`.
        X_WE: Where the gripper let the object go (4, 4), by the measured joints; NaN if it held
            none.
        pushed: How far the object was pushed, [m]; zero if it was not.
        contacts: Where fingers met, at last, what has been at rest since (K, 3): x and y in W by
            the measured joints, and how far within an outline that may be; infinite for what a
            finger came down on, [m].
        seconds: How long it took, from the request to the gripper's return.
    """

    number: int = 0
    outcome: ActionOutcome = ActionOutcome.NONE
    X_WE: Array = unknown(4, 4)
    pushed: float = 0.0
    contacts: Array = field(default_factory=lambda: np.zeros((0, 3)))
    seconds: float = 0.0
