"""The colours of joints and bodies.

Joints keep the green and red of the cross-modal paper's pictures and differ in form too. No network
has one of these colours.
"""

from crossmodal.systems.port_values import HELD_BODY, STATIC_BODY, JointType

JOINT = {
    JointType.PRISMATIC: "#228833",
    JointType.REVOLUTE: "#CC3311",
    JointType.SCREW: "#332288",
    JointType.RIGID: "#8C8C8C",
    JointType.DISCONNECTED: "#BBBBBB",
}
_STATIC = "#D0D0D0"
_INTERACTED = "#FFCC22"
_OTHERS = ("#33BBEE", "#EE3377", "#99DD55", "#BB88FF")


def body_label(body_id: int) -> str:
    """What a legend calls the features of a body."""
    if body_id == STATIC_BODY:
        return "resting features"
    return (
        "features of the held body"
        if body_id == HELD_BODY
        else f"features of moving body {body_id}"
    )


def body_color(body_id: int) -> str:
    """Of the features of a body; the same body always has the same colour."""
    if body_id == STATIC_BODY:
        return _STATIC
    if body_id == HELD_BODY:
        return _INTERACTED
    return _OTHERS[(body_id - 2) % len(_OTHERS)]
