"""How two fingers close on something and hold it, by their taxels and encoders."""

from dataclasses import dataclass, field, replace

import numpy as np

from crossmodal.controllers.primitives.move_object_config import GripConfig
from crossmodal.maths.arrays import Array, Mask
from crossmodal.maths.immutable import Immutable
from crossmodal.models.gripper_taxels import TRAVEL, gripper_taxels

# Into the object along the opening, the left finger's and the right one's; E's x is the left one's.
_SIGNS = np.array([1.0, -1.0])
_LAYOUT = gripper_taxels()
# Towards the other finger, for taxels between the fingers (140,); zero for all others: those at the
# ends may stand on a table.
INWARDS = np.where(_LAYOUT.n_E[:, 0] * _SIGNS[_LAYOUT.finger] < -0.5, _SIGNS[_LAYOUT.finger], 0.0)
_GAIN = 0.1  # Share of the error of the force that is corrected by a decision.
LOADED = 5.0  # Standard deviations of its noise: a taxel that is pressed.


@dataclass(frozen=True, kw_only=True)
class FingerForces(Immutable):
    """What presses the fingers from between them.

    Attributes:
        normal: Of each finger along the opening (2,), [N].
        shear: Of both together across it (2,), along y and z of E, [N].
    """

    normal: Array
    shear: Array

    @property
    def load(self) -> float:
        """Size of the shear, [N]."""
        return float(np.linalg.norm(self.shear))


def finger_forces(forces: Array, noise: float) -> FingerForces:
    """Sums over the taxels between the fingers that are pressed.

    Args:
        forces: On the 140 taxels (140, 3), in E, [N].
        noise: Standard deviation of a component of these, [N].
    """
    inwards = INWARDS * forces[:, 0]
    pressed = inwards > LOADED * noise
    normal = np.where(pressed, inwards, 0.0).reshape(2, -1).sum(axis=1)
    return FingerForces(normal=normal, shear=forces[pressed, 1:].sum(axis=0))


@dataclass(frozen=True, kw_only=True)
class Grip(Immutable):
    """The fingers' commands, and what they hold.

    A finger that meets something waits for the other one, so that an object that is not in the
    middle is not moved; then both press. They are commanded beyond where they are: their drives
    are springs.

    Attributes:
        command: Commanded positions of the fingers (2,), 0 closed, [m].
        met: Which fingers (2,) have met something.
        since: When both had, [s]; infinite before.
        force: Normal force of a finger that is wanted, [N].
    """

    command: Array = field(default_factory=lambda: np.zeros(2))
    met: Mask = field(default_factory=lambda: np.zeros(2, bool))
    since: float = np.inf
    force: float = 0.0

    def moved(self, goal: float, step: float) -> "Grip":
        """The fingers' commands a step (>= 0) nearer to a goal, nothing being held, [m]."""
        goal = min(max(goal, 0.0), TRAVEL)
        command = self.command + np.clip(goal - self.command, -step, step)
        return Grip(command=command)

    def closing(
        self, forces: FingerForces, measured: Array, time: float, period: float, config: GripConfig
    ) -> "Grip":
        """The grip one decision later, while the fingers close.

        Args:
            forces: That press the fingers.
            measured: Their positions (2,), [m].
            time: Now, [s].
            period: Between decisions, [s].
            config: Of the grip.
        """
        if self.met.all():
            return self.pressing(forces, measured, period, config)
        # A drive that pushes with all its force does not get on: it has met what no taxel feels.
        farthest = measured - config.largest_force / config.stiffness
        at_end = measured < 0.5 * config.least_width
        stalled = (self.command <= farthest) & ~at_end
        new = ~self.met & ((forces.normal > config.contact) | stalled)
        met = self.met | new
        command = np.where(new, measured, self.command)
        other_ends = at_end[::-1] & ~met[::-1]
        step = np.where(~met | other_ends, config.finger_speed * period, 0.0)
        command = np.maximum(command - step, np.maximum(farthest, 0.0))
        done = bool(np.all(met | at_end))
        return replace(
            self,
            command=command,
            met=np.ones(2, bool) if done else met,
            since=time if done else np.inf,
            force=config.force,
        )

    def pressing(
        self, forces: FingerForces, measured: Array, period: float, config: GripConfig
    ) -> "Grip":
        """The grip one decision later, while both fingers press.

        What is wanted grows with what is carried, so that shear over normal stays below what
        friction bears. Both commands move alike: what pushes the object to a side meets the drives'
        stiffness and does not move it. Arguments as for `closing`.
        """
        needed = 0.5 * forces.load / config.load
        force = float(np.clip(max(needed, self.force), config.force, config.largest_force))
        error = (force - forces.normal.mean()) / config.stiffness
        most = self.command.mean() - measured.mean() + config.largest_force / config.stiffness
        step = min(_GAIN * error, config.finger_speed * period, most)
        return replace(self, command=self.command - step, force=force)

    def has(self, forces: FingerForces, measured: Array, config: GripConfig) -> bool:
        """Whether something is between the fingers: they are apart and press.

        By their taxels or, since those do not cover all of a finger, by their drives.
        """
        drives = config.stiffness * np.maximum(measured - self.command, 0.0)
        pressed = max(forces.normal.sum(), drives.sum()) > config.force
        return bool(pressed and measured.sum() > config.least_width)

    def slips(self, forces: FingerForces, config: GripConfig) -> bool:
        """Whether even the largest force does not bear what is carried."""
        share = config.largest_load * forces.normal.sum()
        return self.force >= config.largest_force and forces.load > share
