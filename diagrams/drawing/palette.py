"""The colours of every picture: one per modality, per kind of joint and per body.

Modalities use Paul Tol's bright scheme, which stays distinct for colour-blind readers; joints keep
the green and red of the paper's pictures and differ in form too.
"""

from systems.port_values import HELD_BODY, STATIC_BODY, JointType

MODALITY = {"vision": "#4477AA", "proprioception": "#EE7733", "crossmodal": "#AA3377"}
MODALITY_LABEL = {
    "vision": "vision",
    "proprioception": "proprioception",
    "crossmodal": "cross-modal",
}
TRUTH = "#222222"
QUIET = "#8C8C8C"  # Grid text, events, what does not move.
JOINT = {
    JointType.PRISMATIC: "#228833",
    JointType.REVOLUTE: "#CC3311",
    JointType.RIGID: "#8C8C8C",
    JointType.DISCONNECTED: "#BBBBBB",
}
PLAN = "#2255EE"  # The way before the hand.
_STATIC = "#D0D0D0"
_HELD = "#FFCC22"
_OTHERS = ("#33BBEE", "#EE3377", "#99DD55", "#BB88FF")


RESTING_IN_SCENE = "#3A3A3A"  # Resting features among the light surfaces of Meshcat.


def body_label(body_id: int) -> str:
    """What a legend calls the features of a body."""
    if body_id == STATIC_BODY:
        return "resting features"
    return "of the held body" if body_id == HELD_BODY else f"of moving body {body_id}"


def body_color(body_id: int) -> str:
    """Of the features of a body; the same body always has the same colour."""
    if body_id == STATIC_BODY:
        return _STATIC
    if body_id == HELD_BODY:
        return _HELD
    return _OTHERS[(body_id - 2) % len(_OTHERS)]


def rgb(color: str) -> tuple[float, float, float]:
    """Red, green and blue, each 0 to 1, of '#RRGGBB'."""
    red, green, blue = (int(color[i : i + 2], 16) / 255.0 for i in (1, 3, 5))
    return red, green, blue
