"""The joints of the soft hand, after the RBO Hand 2: five fingers of three joints each."""

from dataclasses import dataclass

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex

from crossmodal.maths.arrays import Array
from crossmodal.models import SDF_DIR
from crossmodal.plants.scene import position_index

HAND_FILE = SDF_DIR / "soft_hand.sdf"
FINGER_JOINTS = [
    f"{finger}_joint_{link}"
    for finger in ("index", "middle", "ring", "little", "thumb")
    for link in (1, 2, 3)
]
# Typical finger angles of the hand around a handle, for the robot's picture of itself, [rad].
CLOSED_POSTURE = dict(zip(FINGER_JOINTS, [0.6, 1.0, 1.1] * 4 + [0.8, 0.7, 0.9], strict=True))


@dataclass(frozen=True, kw_only=True)
class GraspRange:
    """The bars, knobs and edges that a hand holds, seen from its grasp frame.

    Attributes:
        least_thickness: [m].
        least_knob: Least thickness of what is shorter than the hand is wide, on a stem, [m].
        most_thickness: Of what passes between its open fingers, [m].
        most_depth: Along the approach, of what the fingers close behind, [m].
        clearance: Least free space behind it, for the fingers, [m].
        behind: Least distance from the frame to what is behind it, [m].
        tips: From the frame to the tips of the closing fingers, [m].
        edge: Most of a board's edge that is between the fingers, from the frame on, [m].
        beside: Least distance from a board's middle to what is beside it, for open fingers, [m].
        tilt: Largest angle from the frame's y to the bar, [rad].
        reach: Largest distance from the frame to the bar, [m].
        gives: How far the hand moves while what it holds stays where it is, [m].
    """

    least_thickness: float
    least_knob: float
    most_thickness: float
    most_depth: float
    clearance: float
    behind: float
    tips: float
    edge: float
    beside: float
    tilt: float
    reach: float
    gives: float


# Measured on the simulated hand, closed as in a run around something that is then drawn out of it:
# in this range it holds 15 N and more, of a board 8 N across it. The guidance takes 2 cm of the gap
# between fingers and thumb.
SOFT_HAND_RANGE = GraspRange(
    least_thickness=0.004,
    least_knob=0.022,
    most_thickness=0.055,
    most_depth=0.055,
    clearance=0.01,
    behind=0.025,
    tips=0.042,
    edge=0.03,
    beside=0.055,
    tilt=0.44,
    reach=0.03,
    gives=0.03,
)


def finger_selection(plant: MultibodyPlant, hand: ModelInstanceIndex) -> Array:
    """Matrix (30, n) that takes the finger joints' angles and rates out of the hand's state."""
    n = plant.num_positions(hand)
    fingers = len(FINGER_JOINTS)
    selection = np.zeros((2 * fingers, 2 * n))
    for row, name in enumerate(FINGER_JOINTS):
        column = position_index(plant, plant.GetJointByName(name, hand))
        selection[row, column] = selection[fingers + row, n + column] = 1.0
    return selection
