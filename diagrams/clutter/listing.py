"""What there is of the clutter application, known without importing it."""

from pathlib import Path

from crossmodal.diagrams.run.experiment import Experiment
from crossmodal.diagrams.run.listing import Listing

LISTING = Listing(
    name="clutter",
    description="finds where a known object is, by views and touches that are chosen",
    scenarios=Path(__file__).parent / "scenarios",
    experiments={
        "clutter": Experiment(
            scenario="clutter",
            description="robots clear the way to an object in dense clutter, then look and touch",
        ),
        "declutter": Experiment(
            scenario="declutter", description="the same without looking and touching afterwards"
        ),
        "pose": Experiment(
            scenario="pose", description="robots: three views, then seven touches, all chosen"
        ),
        "pose-estimation": Experiment(
            scenario="pose-estimation", description="a rig in place of robots: the same"
        ),
        "touches": Experiment(
            scenario="touches", description="three touches by lot, then four chosen ones"
        ),
        "touches-held": Experiment(
            scenario="touches-held", description="the same of an object that is held up"
        ),
        "touches-near": Experiment(
            scenario="touches-near", description="the same from a guess that is 1 to 2 cm off"
        ),
        "touches-faults": Experiment(
            scenario="touches-faults",
            description="as touches, with a real finger, a wrong calibration and false contacts",
        ),
    },
    object_options=("scale",),
)
