"""How tables, plots and the view call the estimators, and their colours."""

LABELS = {"density": "sampled density", "quaternion": "TIQF"}
COLORS = {"density": "#1b9e77", "quaternion": "#d95f02"}
