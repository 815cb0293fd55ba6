"""The experiments: scenarios to be repeated over seeds, and what to compare their figures with."""

from dataclasses import dataclass, field

from diagrams.crossmodal.scenario import scenario_files
from diagrams.run.yaml_schema import ScenarioError, suggestion

ALL = "all"
# Everything is tuned on the seeds below; a count of seeds starts here.
FIRST_SEED = 100


@dataclass(kw_only=True)
class Reference:
    """What a row of an experiment's table is compared with.

    Attributes:
        paper: What the paper reports.
        goal: What this project wants to reach.
    """

    paper: str = ""
    goal: str = ""


@dataclass(kw_only=True)
class Experiment:
    """A scenario to be repeated over seeds.

    Attributes:
        scenario: Its name.
        description: One line.
        references: By the title of a row of the table.
        returns: Whether the object is to be brought back after the exploration.
    """

    scenario: str
    description: str
    references: dict[str, Reference] = field(default_factory=dict)
    returns: bool = False


_COMMON = {
    "joint type right at the end": Reference(paper="yes", goal="95 %"),
    "tick": Reference(goal="66.7 ms budget"),
}


def _return(
    scenario: str, description: str, *, exploration: Reference, exploitation: Reference
) -> Experiment:
    """An experiment in which the object is brought back by what was perceived."""
    return Experiment(
        scenario=scenario,
        description=description,
        references={
            "task done": Reference(paper="5/5", goal="19/20"),
            "exploration error": exploration,
            "exploitation error": exploitation,
            **_COMMON,
        },
        returns=True,
    )


# The paper's figures are its section VII-B and Table I (mean ± standard deviation of 5 trials);
# the others there are of one run each.
_ALL = (
    Experiment(
        scenario="drawer",
        description="a drawer is pulled open, in light",
        references={"task done": Reference(paper="works"), **_COMMON},
    ),
    Experiment(
        scenario="drawer-lights-off",
        description="the same, and the lights go off on the way",
        references={
            "task done": Reference(paper="works"),
            "configuration error at the end": Reference(
                paper="vision stops in the dark, proprioception 5 mm, cross-modal 2 mm of 225",
                goal="cross-modal 4 mm",
            ),
            **_COMMON,
        },
    ),
    Experiment(
        scenario="cupboard-door",
        description="a cupboard's door is pulled open, in light",
        references=_COMMON,
    ),
    Experiment(
        scenario="door-occluded",
        description="the robot hides the door while it opens it",
        references={
            "configuration error at the end": Reference(
                paper="vision 42 deg, proprioception 7 deg, cross-modal 5 deg of 85",
                goal="cross-modal 2 deg",
            ),
            **_COMMON,
        },
    ),
    Experiment(
        scenario="door-covered",
        description="the same door, with a cover over the camera",
        references=_COMMON,
    ),
    Experiment(
        scenario="box-lid",
        description="the lid of a box is closed, and the box slides",
        references={
            "joint found": Reference(
                paper="vision no, proprioception no, cross-modal yes", goal="cross-modal 18/20"
            ),
            "configuration error at the end": Reference(
                paper="cross-modal 10 deg of 100", goal="cross-modal 4 deg"
            ),
            **_COMMON,
        },
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
    ),
    _return(
        "sliding-door",
        "a sliding door is opened by 30 cm and closed again",
        exploration=Reference(paper="22 ± 16 mm", goal="10 mm"),
        exploitation=Reference(paper="18 ± 16 mm", goal="10 mm"),
    ),
)
EXPERIMENTS = {experiment.scenario: experiment for experiment in _ALL}


def find_experiments(name: str) -> dict[str, Experiment]:
    """The experiment of that name, or for 'all' every one whose scenario there is.

    Raises:
        ScenarioError: where there is none.
    """
    scenarios = scenario_files()
    if name == ALL:
        return {key: one for key, one in EXPERIMENTS.items() if one.scenario in scenarios}
    if name not in EXPERIMENTS:
        hint = suggestion(name, [*EXPERIMENTS, ALL])
        raise ScenarioError(f"unknown experiment '{name}'; {hint}")
    return {name: EXPERIMENTS[name]}


def parse_seeds(text: str) -> list[int]:
    """Seeds: so many from 100 on ('20'), a range without its end ('100:120') or a list ('1,4,9').

    Raises:
        ScenarioError: where it names no seed, or a negative one.
    """
    try:
        if text.strip().isdigit():
            seeds = list(range(FIRST_SEED, FIRST_SEED + int(text)))
        else:
            seeds = [seed for part in text.split(",") for seed in _part(part)]
    except ValueError:
        raise ScenarioError(
            f"--seeds {text}: expected a count such as 20, a range such as 100:120"
            " or a list such as 3,5,8"
        ) from None
    if not seeds or min(seeds) < 0:
        raise ScenarioError(f"--seeds {text}: names no seed, or a negative one")
    return list(dict.fromkeys(seeds))


def _part(text: str) -> range:
    first, colon, last = text.strip().partition(":")
    return range(int(first), int(last) if colon else int(first) + 1)
