"""What the two estimators of the tool's kinematics are called and drawn in."""

ESTIMATORS = ("geometric", "filtered")
LABELS = {"geometric": "geometric", "filtered": "joint filters"}
COLORS = {"geometric": "#4477AA", "filtered": "#AA3377"}
