"""The experiments: scenarios to be repeated over seeds, and what to compare their metrics with."""

from collections.abc import Sequence

from crossmodal.diagrams.run.experiment import Experiment, Reference

# What a reader of the tables has to know.
_AFTER_A_RETURN = (
    "The errors at the end are those after the return, at a configuration near zero, where an axis"
    " or a scale that is off no longer shows; those at the turning point stand beside them."
)
_PLAIN = (
    "The object is plain: vision sees hardly anything of it, and the cross-modal column is"
    " proprioception's."
)
_COMMON = {
    "type_right": Reference(paper="yes", goal="95 %"),
    "tick_median": Reference(goal="66.7 ms budget"),
}


def _exploration(scenario: str, description: str, **references: Reference) -> Experiment:
    """An experiment that only explores: where the object was to be brought is no target."""
    return Experiment(
        scenario=scenario,
        description=description,
        references={**references, **_COMMON},
        without=("exploration_error", "exploitation_error"),
    )


def _return(
    scenario: str,
    description: str,
    *,
    exploration: Reference,
    exploitation: Reference,
    notes: Sequence[str] = (),
) -> Experiment:
    """An experiment in which the object is brought back by what was perceived."""
    return Experiment(
        scenario=scenario,
        description=description,
        references={
            "success": Reference(paper="5/5", goal="19/20"),
            "exploration_error": exploration,
            "exploitation_error": exploitation,
            **_COMMON,
        },
        notes=(_AFTER_A_RETURN, *notes),
    )


# The paper's figures are its section VII-B and Table I (mean ± standard deviation of 5 trials);
# the others there are of one run each.
_ALL = (
    _exploration("drawer", "a drawer is pulled open, in light", success=Reference(paper="works")),
    _exploration(
        "drawer-lights-off",
        "the same, and the lights go off on the way",
        success=Reference(paper="works"),
        configuration_error=Reference(
            paper="vision stops in the dark, proprioception 5 mm, cross-modal 2 mm of 225",
            goal="cross-modal 4 mm",
        ),
    ),
    _exploration("cupboard-door", "a cupboard's door is pulled open, in light"),
    _exploration(
        "drawer-miscalibrated", "the drawer, with camera and arm calibrated as in a laboratory"
    ),
    _exploration(
        "cupboard-door-miscalibrated",
        "the cupboard's door, with camera and arm calibrated as in a laboratory",
    ),
    _exploration(
        "door-occluded",
        "the robot hides the door while it opens it",
        configuration_error=Reference(
            paper="vision 42 deg, proprioception 7 deg, cross-modal 5 deg of 85",
            goal="cross-modal 2 deg",
        ),
    ),
    _exploration("door-covered", "the same door, with a cover over the camera"),
    _exploration(
        "box-lid",
        "the lid of a box is closed, and the box slides",
        joint_found=Reference(
            paper="vision no, proprioception no, cross-modal yes", goal="cross-modal 18/20"
        ),
        configuration_error=Reference(paper="cross-modal 10 deg of 100", goal="cross-modal 4 deg"),
    ),
    _return(
        "glass-door",
        "a glass door is opened by 20 deg and closed again",
        exploration=Reference(paper="1.3 ± 0.73 deg", goal="1.0 deg"),
        exploitation=Reference(paper="0.6 ± 0.5 deg", goal="0.6 deg"),
    ),
    _return(
        "tripod",
        "a camera tripod's head is turned by 45 deg and back",
        exploration=Reference(paper="7.8 ± 2.3 deg", goal="4 deg"),
        exploitation=Reference(paper="2.6 ± 2.24 deg", goal="2.5 deg"),
        notes=(_PLAIN,),
    ),
    _return(
        "sliding-door",
        "a sliding door is opened by 30 cm and closed again",
        exploration=Reference(paper="22 ± 16 mm", goal="10 mm"),
        exploitation=Reference(paper="18 ± 16 mm", goal="10 mm"),
        notes=(_PLAIN,),
    ),
    Experiment(
        scenario="press",
        description="the screw of a fly press is turned by 60 deg and back",
        references={"tick_median": _COMMON["tick_median"]},
        notes=(_AFTER_A_RETURN, "The paper has no screw."),
    ),
)
EXPERIMENTS = {experiment.scenario: experiment for experiment in _ALL}
