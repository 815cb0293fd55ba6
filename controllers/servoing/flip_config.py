"""What the flipping of a flap goes by: its goal, speeds and limits, and who moves what."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from crossmodal.maths.validation import number, numbers

_SWITCH: Any = {"at_least": 0.0, "at_most": 1.0}


@dataclass(kw_only=True)
class FlipSequenceConfig:
    """Phases, speeds and limits.

    Attributes:
        force: That the contact should have, [N]. It is no field: the station hands it over, as to
            `TactileServoing`.
    """

    force = 0.5
    period: float = number(0.01, at_least=1e-4, at_most=1.0, unit="s")  # Update period.
    # Speed at which the finger first approaches the flap's edge.
    approach_speed: float = number(0.008, above=0.0, at_most=1.0, unit="m/s")
    # Displacement of the first approach after which nothing was touched.
    approach_displacement: float = number(0.06, above=0.0, at_most=1.0, unit="m")
    # What the force of an established contact may be off by.
    force_tolerance: float = number(0.1, above=0.0, at_most=100.0, unit="N")
    # What the place of an established contact may be off by.
    position_tolerance: float = number(0.004, above=0.0, at_most=0.1, unit="m")
    # How long force and place have to be within these, for a contact to be established.
    settle_time: float = number(0.3, at_least=0.0, at_most=60.0, unit="s")
    # Time after which a contact that has not settled is taken as it is.
    establish_time: float = number(4.0, above=0.0, at_most=3600.0, unit="s")
    # Speed of the contact along x_S.
    feed_speed: float = number(0.007, above=0.0, at_most=1.0, unit="m/s")
    # Time in which `feed_speed` is reached.
    ramp_time: float = number(0.5, at_least=1e-3, at_most=60.0, unit="s")
    # Angle by which the flap is to be turned.
    angle: float = number(2.0, above=0.0, at_most=3.0, unit="rad")
    # Displacement of the contact after which the flip ends at the latest.
    displacement: float = number(0.25, above=0.0, at_most=2.0, unit="m")
    # A contact is lost once nothing has been sensed for so long.
    lost_time: float = number(0.05, at_least=0.0, at_most=10.0, unit="s")
    # Speed at which a lost contact is sought along its last normal.
    search_speed: float = number(0.008, above=0.0, at_most=1.0, unit="m/s")
    # Displacement after which a lost contact is lost for good.
    search_displacement: float = number(0.05, above=0.0, at_most=1.0, unit="m")
    # Time after which a lost contact is lost for good.
    search_time: float = number(40.0, above=0.0, at_most=3600.0, unit="s")
    # The finger goes so far beyond the expected place of an edge. If it then senses no contact, it
    # seeks beside that place, in steps along the edge's arc, on both sides in turns, so often.
    probe_depth: float = number(0.01, above=0.0, at_most=1.0, unit="m")
    # Distance along the edge's arc between two places where a lost edge is sought.
    probe_step: float = number(0.012, above=0.0, at_most=1.0, unit="m")
    # How many places beside the expected one are tried.
    probes: int = number(6, at_least=0, at_most=100)
    # A flap is followed once its edge is seen to have gone so far.
    edge_shift: float = number(0.005, above=0.0, at_most=1.0, unit="m")
    # Distance before an edge that has gone, to which the finger goes first.
    clearance: float = number(0.015, above=0.0, at_most=1.0, unit="m")
    # Highest speed at which the finger follows an edge that has gone.
    follow_speed: float = number(0.03, above=0.0, at_most=1.0, unit="m/s")
    # Largest angle on the edge's arc between the finger and its next goal.
    arc_step: float = number(0.25, above=0.0, at_most=1.6, unit="rad")
    # How near the finger gets to where it waits before the edge.
    arrival_distance: float = number(0.002, above=0.0, at_most=0.1, unit="m")
    # How far the finger may be turned from how it is to wait there, or to approach first.
    arrival_angle: float = number(0.03, above=0.0, at_most=1.0, unit="rad")
    # Once the flap is turned, the finger goes so far in its own frame: off the edge, and along
    # itself towards its arm, which straightens if it only backs off.
    retreat: np.ndarray = numbers(
        np.array([0.0, -0.04, -0.10]), at_least=-1.0, at_most=1.0, unit="m"
    )
    retreat_speed: float = number(0.06, above=0.0, at_most=1.0, unit="m/s")  # Of the retreat.
    # Diagonals of the projectors, ones and zeros: w_x, w_y, w_z, v_x, v_y, v_z. Touch holds the
    # force and rolls the pad flat onto the edge's line, about x; during the flip it also keeps the
    # edge from sliding off along x. The roll about z is vision's and the arc's: on an edge that is
    # as thick as the pad's contact is wide, an offset along x may be either of roll and place.
    tactile_establish: list[float] = numbers([1.0, 0.0, 0.0, 0.0, 1.0, 0.0], **_SWITCH)
    # Touch's projector during the flip, in that order.
    tactile_flip: list[float] = numbers([1.0, 0.0, 0.0, 1.0, 1.0, 0.0], **_SWITCH)
    # A pad that is not rolled as the flap is would push it away from the turn.
    visual_establish: list[float] = numbers([0.0, 0.0, 1.0, 0.0, 0.0, 0.0], **_SWITCH)
    # The same before the first contact: the whole finger turns to the flap.
    visual_flip: list[float] = numbers([1.0, 1.0, 1.0, 1.0, 1.0, 1.0], **_SWITCH)
