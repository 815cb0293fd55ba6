"""The system that turns the motions of bodies into the joints between them."""

from dataclasses import dataclass, field

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context, LeafSystem, State, ValueProducer

from systems.kinematics.joint_filters import JointFilters, JointFiltersConfig
from systems.kinematics.joint_pairs import PairLevel, merge_bodies, predict_bodies, update_pairs
from systems.port_values import BodyMotions, BodyPredictions, JointBeliefs


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
    for name in ("period", "reference_age", "heritage", "rest_rotation", "rest_translation"):
        if not (value := getattr(config, name)) > 0.0 or not np.isfinite(value):
            unit = {"rest_rotation": "rad", "rest_translation": "m"}.get(name, "s")
            raise ValueError(f"KinematicModel: need {name} > 0 {unit}, got {value!r}")
    if not config.patience >= 0.0:
        raise ValueError(f"KinematicModel: need patience >= 0 s, got {config.patience!r}")
    if config.max_pairs < 1:
        raise ValueError(f"KinematicModel: need max_pairs >= 1, got {config.max_pairs!r}")
    if not 0.0 <= config.least_probability <= 1.0:
        raise ValueError(
            f"KinematicModel: need 0 <= least_probability <= 1, got {config.least_probability!r}"
        )
    if inputs < 1:
        raise ValueError(f"KinematicModel: need inputs >= 1, got {inputs!r}")


class KinematicModel(LeafSystem):
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
        self._bodies = [
            self.DeclareAbstractInputPort(name, AbstractValue.Make(BodyMotions())) for name in names
        ]
        empty = PairLevel(pairs={}, bodies={}, past={}, unseen={}, ticks=0)
        self._state = self.DeclareAbstractState(AbstractValue.Make(empty))
        state_only = {self.abstract_state_ticket(self._state)}
        self._posterior = self.DeclareCacheEntry(
            description="pairs of this tick",
            value_producer=ValueProducer(
                allocate=lambda: AbstractValue.Make(empty), calc=self._calc_level
            ),
            prerequisites_of_calc={*state_only, self.all_input_ports_ticket()},
        )
        self.DeclareAbstractOutputPort(
            "joints_estimated",
            lambda: AbstractValue.Make(JointBeliefs()),
            self._calc_estimated,
            prerequisites_of_calc={self._posterior.ticket()},
        )
        self.DeclareAbstractOutputPort(
            "joints_latest",
            lambda: AbstractValue.Make(JointBeliefs()),
            self._calc_latest,
            prerequisites_of_calc=state_only,
        )
        self.DeclareAbstractOutputPort(
            "body_motions_latest",
            lambda: AbstractValue.Make(BodyMotions()),
            self._calc_bodies,
            prerequisites_of_calc=state_only,
        )
        self.DeclareAbstractOutputPort(
            "bodies_predicted",
            lambda: AbstractValue.Make(BodyPredictions()),
            self._calc_predicted,
            prerequisites_of_calc=state_only,
        )
        self.DeclarePeriodicUnrestrictedUpdateEvent(config.period, 0.0, self._update)

    def _stored(self, context: Context) -> PairLevel:
        level: PairLevel = context.get_abstract_state(int(self._state)).get_value()
        return level

    def _calc_level(self, context: Context, output: AbstractValue) -> None:
        config = self._config
        bodies = merge_bodies([p.Eval(context) for p in self._bodies if p.HasValue(context)])
        output.set_value(
            update_pairs(
                self._stored(context),
                bodies,
                self._filters,
                config.period,
                config.reference_age,
                config.patience,
                config.max_pairs,
                max(1, round(config.heritage / config.period)),
                np.repeat([config.rest_rotation, config.rest_translation], 3),
            )
        )

    def _beliefs(self, level: PairLevel) -> JointBeliefs:
        return JointBeliefs(joints=[self._filters.belief(s) for s in level.pairs.values()])

    def _calc_estimated(self, context: Context, output: AbstractValue) -> None:
        output.set_value(self._beliefs(self._posterior.EvalAbstract(context).get_value()))

    def _calc_latest(self, context: Context, output: AbstractValue) -> None:
        output.set_value(self._beliefs(self._stored(context)))

    def _calc_bodies(self, context: Context, output: AbstractValue) -> None:
        level = self._stored(context)
        output.set_value(BodyMotions(bodies=[level.bodies[i] for i in sorted(level.bodies)]))

    def _calc_predicted(self, context: Context, output: AbstractValue) -> None:
        config = self._config
        predictions = predict_bodies(
            self._stored(context), self._filters, config.period, config.least_probability
        )
        output.set_value(BodyPredictions(predictions=predictions))

    def _update(self, context: Context, state: State) -> None:
        level = self._posterior.EvalAbstract(context).get_value()
        state.get_mutable_abstract_state(int(self._state)).set_value(level)
