"""What there is of the cross-modal application, known without importing it."""

from pathlib import Path

from crossmodal.diagrams.crossmodal.studies.experiments import EXPERIMENTS
from crossmodal.diagrams.run.listing import Listing

LISTING = Listing(
    name="crossmodal",
    description="an arm with a soft hand finds the joint of an unknown object while it explores it",
    scenarios=Path(__file__).parent / "scenarios",
    experiments=EXPERIMENTS,
    object_options=("grasp_frame", "joint", "pull_direction", "object_pose", "scale"),
)
