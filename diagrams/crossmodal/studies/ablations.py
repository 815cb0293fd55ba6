"""The cross-modal flows of information, each shown by cutting the connection that carries it.

An episode is simulated once and its sensor streams are kept; the cross-modal network then perceives
them twice, whole and with the connection cut, so that nothing else differs.
"""

from dataclasses import dataclass, field

from crossmodal.diagrams.run.yaml_input.schema import ScenarioError, suggestion


@dataclass(kw_only=True)
class Ablation:
    """A flow of information, where it matters, and the connection that carries it.

    Attributes:
        flow: What is shown, in one line.
        scenario: Its name.
        connection: One of `CROSSMODAL_CONNECTIONS`.
        overrides: Assignments to the scenario.
    """

    flow: str
    scenario: str
    connection: str
    overrides: list[str] = field(default_factory=list)


_DARK = ["disturbances.lights_off=[{start: 14.0}]"]

ABLATIONS = {
    "grasp-in-the-dark": Ablation(
        flow="the grasp learnt with vision carries the hand when the light is off",
        scenario="cupboard-door",
        connection="held_body_to_grasp",
        overrides=_DARK,
    ),
    "corrected-by-vision": Ablation(
        flow="what vision has corrected carries the hand's reading when the light is off",
        scenario="cupboard-door",
        connection="features_to_held_body",
        overrides=_DARK,
    ),
    "body-in-the-hand": Ablation(
        flow="the body felt by the hand shows vision which features are its own",
        scenario="drawer-lights-off",
        connection="held_body_to_vision",
    ),
    "behind-the-arm": Ablation(
        flow="the body felt by the hand shows vision which features are its own, once they show",
        scenario="door-occluded",
        connection="held_body_to_vision",
    ),
    "seen-reference": Ablation(
        flow="a body that only vision follows is the reference of a joint felt by the hand",
        scenario="box-lid",
        connection="visual_bodies_to_joints",
    ),
}


def find_ablation(name: str) -> Ablation:
    if name not in ABLATIONS:
        raise ScenarioError(f"unknown ablation '{name}'; {suggestion(name, ABLATIONS)}")
    return ABLATIONS[name]
