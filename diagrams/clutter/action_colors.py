"""Colours of the declutter graph: the target, and objects by how they are taken away."""

from crossmodal.diagrams.drawing.palette import QUIET
from crossmodal.systems.port_values import DeclutterAction

TARGET = "#AA3377"
COLORS = {DeclutterAction.GRASP: "#228833", DeclutterAction.PUSH: "#EE7733", None: QUIET}
