"""What the three wirings of the cross-modal network are called and drawn in.

The colours are Paul Tol's bright scheme.
"""

MODALITIES = ("vision", "proprioception", "crossmodal")
SEEING, FEELING = ("vision", "crossmodal"), ("proprioception", "crossmodal")
LABELS = {
    "vision": "vision",
    "proprioception": "proprioception",
    "crossmodal": "cross-modal",
}
COLORS = {"vision": "#4477AA", "proprioception": "#EE7733", "crossmodal": "#AA3377"}
