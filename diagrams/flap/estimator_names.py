"""What the estimators of the tool's kinematics are called and drawn in."""

ESTIMATORS = ("geometric", "filtered", "planes")
LABELS = {"geometric": "geometric", "filtered": "joint filters", "planes": "the paper's planes"}
COLORS = {"geometric": "#4477AA", "filtered": "#AA3377", "planes": "#CCBB44"}
