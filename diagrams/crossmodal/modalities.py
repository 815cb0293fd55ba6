"""What the three wirings of the cross-modal network are called and drawn in.

The colours are Paul Tol's bright scheme; those of the grasp's types are of his light one.
"""

from crossmodal.diagrams.run.scenario import Scenario
from crossmodal.systems.port_values import GraspType

MODALITIES = ("vision", "proprioception", "crossmodal")
SEEING, FEELING = ("vision", "crossmodal"), ("proprioception", "crossmodal")
LABELS = {
    "vision": "vision",
    "proprioception": "proprioception",
    "crossmodal": "cross-modal",
}
COLORS = {"vision": "#4477AA", "proprioception": "#EE7733", "crossmodal": "#AA3377"}
GRASP_COLORS = {
    str(GraspType.PERFECT): "#44BB99",
    str(GraspType.REVOLUTE): "#BBCC33",
    str(GraspType.CYLINDRICAL): "#EEDD88",
    str(GraspType.FAILED): "#DDDDDD",
}


def sees(scenario: Scenario) -> bool:
    """Whether any of a scenario's estimators reads the camera's images."""
    return any(scenario.original(name) in SEEING for name in scenario.modalities)
