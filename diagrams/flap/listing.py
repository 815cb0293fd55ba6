"""What there is of the flap application, known without importing it."""

from pathlib import Path

from crossmodal.diagrams.flap.experiments import EXPERIMENTS
from crossmodal.diagrams.run.listing import Listing

LISTING = Listing(
    name="flap",
    description="a tactile fingertip flips the flap of a held tool and learns how it is hinged",
    scenarios=Path(__file__).parent / "scenarios",
    experiments=EXPERIMENTS,
    object_options=(),
)
