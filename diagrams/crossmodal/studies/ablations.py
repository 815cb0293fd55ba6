"""The cross-modal flows of information, each shown by cutting the one wire that carries it.

An episode is simulated once and its sensor streams are kept; the cross-modal network then perceives
them twice, whole and with the wire cut, so that nothing else differs.
"""

from dataclasses import dataclass, field

from crossmodal.diagrams.run.yaml_input.schema import ScenarioError, suggestion


@dataclass(kw_only=True)
class Ablation:
    """A flow of information, where it matters, and the wire that carries it.

    Attributes:
        flow: What is shown, in one line.
        scenario: Its name.
        wire: One of `CROSSMODAL_WIRES`.
        overrides: Assignments to the scenario.
    """

    flow: str
    scenario: str
    wire: str
    overrides: list[str] = field(default_factory=list)


_DARK = ["disturbances.lights_off=[{start: 14.0}]"]

ABLATIONS = {
    "grasp-in-the-dark": Ablation(
        flow="the grasp learnt with the eye carries the hand when the light is off",
        scenario="cupboard-door",
        wire="held_body_to_grasp",
        overrides=_DARK,
    ),
    "taught-by-the-eye": Ablation(
        flow="what the eye has corrected carries the hand's reading when the light is off",
        scenario="cupboard-door",
        wire="features_to_held_body",
        overrides=_DARK,
    ),
    "body-in-the-hand": Ablation(
        flow="the body felt by the hand tells the eye which features are its own",
        scenario="drawer-lights-off",
        wire="held_body_to_vision",
    ),
    "behind-the-arm": Ablation(
        flow="the body felt by the hand tells the eye which features are its own, once they show",
        scenario="door-occluded",
        wire="held_body_to_vision",
    ),
    "seen-reference": Ablation(
        flow="a body that only the eye follows is the reference of a joint felt by the hand",
        scenario="box-lid",
        wire="visual_bodies_to_joints",
    ),
}


def find_ablation(name: str) -> Ablation:
    if name not in ABLATIONS:
        raise ScenarioError(f"unknown ablation '{name}'; {suggestion(name, ABLATIONS)}")
    return ABLATIONS[name]
