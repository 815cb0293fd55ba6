"""The system that turns the motions of bodies into the joints between them."""

from dataclasses import dataclass, field

import numpy as np
from pydrake.systems.framework import Context

from systems.checks import require, require_fields
from systems.kinematics.joint_filters import JointFilters, JointFiltersConfig
from systems.kinematics.joint_pairs import PairLevel, merge_bodies, predict_bodies, update_pairs
from systems.port_values import BodyMotions, BodyPredictions, JointBeliefs
from systems.recursive_filter import RecursiveFilter


@dataclass(kw_only=True)
class KinematicModelConfig:
    """Configuration of `KinematicModel`.

    Attributes:
        period: Of the ticks, [s].
        filters: Of every pair.
        reference_age: How long before a body was first measured its reference may be, [s].
        patience: How long a pair outlives its bodies' measurements, [s].
        max_pairs: Most pairs at a time; pairs with the static environment come first.
        heritage: How long ago a body may have stood still last to take over what is known of
            another one's joint to the environment that it belonged to, [s].
        rest_rotation: How far a parent that is not measured any more may have turned after one
            second, [rad]; it is taken to rest for as long as it was followed.
        rest_translation: The same for its way, [m].
        least_probability: Of a joint type, for its prediction to be sent down.
    """

    period: float = 1.0 / 15.0
    filters: JointFiltersConfig = field(default_factory=JointFiltersConfig)
    reference_age: float = 1.0
    patience: float = 1.0
    max_pairs: int = 10
    heritage: float = 3.0
    rest_rotation: float = 0.05
    rest_translation: float = 0.01
    least_probability: float = 0.01


def _check(config: KinematicModelConfig, inputs: int) -> None:
    name = "KinematicModel"
    seconds = ("period", "reference_age", "heritage")
    require_fields(name, config, seconds, "> 0 s", lambda value: value > 0.0)
    require_fields(name, config, ["rest_rotation"], "> 0 rad", lambda value: value > 0.0)
    require_fields(name, config, ["rest_translation"], "> 0 m", lambda value: value > 0.0)
    require(config.patience >= 0.0, name, config, "patience", ">= 0 s")
    require(config.max_pairs >= 1, name, config, "max_pairs", ">= 1")
    probable = 0.0 <= config.least_probability <= 1.0
    require(probable, name, config, "least_probability", "from 0 to 1")
    if inputs < 1:
        raise ValueError(f"{name}: inputs = {inputs!r}, need >= 1")


def known_bodies(level: PairLevel) -> BodyMotions:
    """The bodies that the pairs belong to, by id."""
    return BodyMotions(bodies=[level.bodies[i] for i in sorted(level.bodies)])


class KinematicModel(RecursiveFilter):
    """Joints between bodies: type, parameters and configuration, from relative poses.

    For every pair of a parent P (the static environment, or a moving body of higher id) and a child
    B, four models explain all relative poses measured so far,

        X_PB(t) = X_PF E(q(t)) Y exp(noise),

    with a constant screw E (prismatic, revolute), none (rigid) or a free walk (disconnected). Their
    probabilities follow from their evidence; see `JointFilters`. A body that begins to move after B
    belonged to the environment until then, and so takes over what is known of B's joint to it. A
    parent that is not measured any more is taken to rest, with growing covariance.

    .. pydrake_system::

        name: KinematicModel
        input_ports:
        - body_motions
        - body_motions_1 (one port per input; the first has no number)
        output_ports:
        - joints_estimated
        - joints_latest
        - body_motions_latest
        - bodies_predicted

    - `body_motions`, `body_motions_1`, ...: `BodyMotions` of this tick in W; a later port overrides
      a body id of an earlier one. An unconnected port counts as empty.
    - `joints_estimated`: `JointBeliefs` of this tick, in P; for other filters only.
    - `joints_latest`: the same of the last tick, from the state.
    - `body_motions_latest`: `BodyMotions` that the joints belong to, from the state; a body that is
      not measured any more stays, as it was, for as long as its joints do.
    - `bodies_predicted`: `BodyPredictions` X_WB at the next tick, from the state: by every joint
      type that is probable enough, each child's likeliest first.

    Frames: W world, P parent, B child, F the child's measured reference pose.

    Source: of the role, R. Martin-Martin and O. Brock, Cross-modal interpretation of multi-modal
    sensor streams, section III; the filters are our own.

    Args:
        config: See `KinematicModelConfig`.
        inputs: Number of `body_motions` ports.
    """

    def __init__(self, config: KinematicModelConfig, inputs: int = 1) -> None:
        super().__init__()
        _check(config, inputs)
        self._config = config
        self._filters = JointFilters(config.filters, owner="KinematicModel")
        names = ["body_motions"] + [f"body_motions_{i}" for i in range(1, inputs)]
        self._bodies = [self._declare_value_input(name, BodyMotions()) for name in names]
        empty = PairLevel(pairs={}, bodies={}, past={}, unseen={}, ticks=0)
        self._declare_recursion(empty, self._calc_level, config.period)
        self._declare_estimated("joints_estimated", self._beliefs)
        self._declare_latest("joints_latest", self._beliefs)
        self._declare_latest("body_motions_latest", known_bodies)
        self._declare_latest("bodies_predicted", self._predict)

    def _calc_level(self, context: Context, level: PairLevel) -> PairLevel:
        config = self._config
        sources = [self._read(port, context) for port in self._bodies if port.HasValue(context)]
        return update_pairs(
            level,
            merge_bodies(sources),
            self._filters,
            config.period,
            config.reference_age,
            config.patience,
            config.max_pairs,
            max(1, round(config.heritage / config.period)),
            np.repeat([config.rest_rotation, config.rest_translation], 3),
        )

    def _beliefs(self, level: PairLevel) -> JointBeliefs:
        return JointBeliefs(joints=[self._filters.belief(s) for s in level.pairs.values()])

    def _predict(self, level: PairLevel) -> BodyPredictions:
        config = self._config
        return BodyPredictions(
            predictions=predict_bodies(
                level, self._filters, config.period, config.least_probability
            )
        )
