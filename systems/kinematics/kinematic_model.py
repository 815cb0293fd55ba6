"""The system that turns the motions of bodies into the joints between them."""

from functools import partial

import numpy as np
from pydrake.systems.framework import Context

from crossmodal.maths.validation import check
from crossmodal.systems.kinematics.calibration_errors import (
    PERFECT,
    SensorCalibration,
    with_calibration,
)
from crossmodal.systems.kinematics.joint_filters import JointFilters
from crossmodal.systems.kinematics.joint_graph import (
    EMPTY_GRAPH,
    JointGraphState,
    KinematicModelConfig,
    grasp_configuration,
    is_felt_alone,
    merge_bodies,
    predict_bodies,
    update_graph,
)
from crossmodal.systems.port_values import MOVING_TYPES, STATIC_BODY, BodyMotions, JointBeliefs
from crossmodal.systems.recursive_filter import RecursiveFilter


class KinematicModel(RecursiveFilter):
    """Joints between bodies: type, parameters and configuration, from relative poses.

    For every pair of a parent P (the static environment, or a moving body of higher id) and a child
    B, five models explain all relative poses measured so far,

        X_PB(t) = X_PF E(q(t)) Y exp(noise),

    with a constant screw E (prismatic, revolute, screw), none (rigid) or a free motion
    (disconnected). Their probabilities follow from their evidence. The posterior of a tick holds
    each pair's pose keyframes: every update is a maximum a posteriori fit to all of them,
    linearised anew, and what is older than they are is marginalised (`JointFilters`).

    The configuration of a pair that is not measured any more is predicted, ever less surely, for as
    long as the pair is kept.

    The body in the hand takes over the joints of the seen body that it is (`seen_body`), whose
    configurations count from where that rested.

    A body that begins to move after B belonged to the environment until then, so that what is known
    of B's joint to the environment is transferred to the joint between the two. A parent that is
    not measured any more is taken to rest, with growing covariance.

    Input ports:
    - `body_motions`, `body_motions_1`, ...: `BodyMotions` of this tick in W; a later port overrides
      a body id of an earlier one. An unconnected port counts as empty.

    Output ports:
    - `joints_estimated`: `JointBeliefs` of this tick, in P; for other filters only.
    - `joints_latest`: the same of the last tick, from the state, with what the calibration may be
      off by.
    - `body_motions_latest`: `BodyMotions` that the joints belong to, from the state; a body that is
      not measured any more stays, as it was, for as long as its joints do.
    - `bodies_predicted`: `BodyPredictions` X_WB at the next tick, from the state: by every joint
      type that is probable enough, each child's likeliest first.
    - `health_latest`: `StreamHealth` of the bodies' motions, from the state: its fault names the
      bodies that were left out at the last tick, and why. How many measurements of a pair were is
      in its `JointBelief`.

    Frames: W world, P parent, B child, F the child's measured reference pose.

    Source: of the role, R. Martin-Martin and O. Brock, Cross-modal interpretation of multi-modal
    sensor streams, section III; the filters are our own.

    Args:
        inputs: Number of `body_motions` ports.
        camera: Of the bodies that the eye follows.
        arm: Its base, for the body in a hand that no eye has seen.
    """

    def __init__(
        self,
        config: KinematicModelConfig,
        inputs: int = 1,
        camera: SensorCalibration = PERFECT,
        arm: SensorCalibration = PERFECT,
    ) -> None:
        super().__init__()
        check(config, "KinematicModel")
        if inputs < 1:
            raise ValueError(f"KinematicModel: inputs = {inputs!r}, need >= 1")
        self._config = config
        self._camera, self._arm = camera, arm
        self._filters = JointFilters(config.filters, owner="KinematicModel")
        names = ["body_motions"] + [f"body_motions_{i}" for i in range(1, inputs)]
        self._bodies = [self._declare_value_input(name, BodyMotions()) for name in names]
        predict = partial(predict_bodies, filters=self._filters, config=config)
        self._declare_recursion(EMPTY_GRAPH, self._calc_graph, config.period)
        self._declare_estimated("joints_estimated", self._beliefs)
        self._declare_latest("joints_latest", self._reported)
        self._declare_latest(
            "body_motions_latest",
            lambda graph: BodyMotions(bodies=[graph.bodies[i] for i in sorted(graph.bodies)]),
        )
        self._declare_latest("bodies_predicted", predict)
        self._declare_latest("health_latest", lambda graph: graph.health)

    def _calc_graph(self, context: Context, graph: JointGraphState) -> JointGraphState:
        sources = [self._read(port, context) for port in self._bodies if port.HasValue(context)]
        bodies, faults = merge_bodies(sources)
        return update_graph(graph, bodies, self._filters, self._config, faults)

    def _beliefs(self, graph: JointGraphState) -> JointBeliefs:
        now = graph.ticks * self._config.period
        filters, joints = self._filters, []
        for pair, state in graph.pairs.items():
            joint = filters.belief(state, now)
            for joint_type in MOVING_TYPES:
                q = grasp_configuration(graph, pair, joint_type, filters)
                joint.models[joint_type].grasp_configuration = q
            joints.append(joint)
        return JointBeliefs(joints=joints)

    def _reported(self, graph: JointGraphState) -> JointBeliefs:
        joints = []
        for joint in self._beliefs(graph).joints:
            sensor = self._arm if is_felt_alone(graph, joint.child_id) else self._camera
            parent = joint.parent_id
            X_WP = np.eye(4) if parent == STATIC_BODY else graph.bodies[parent].motion.X
            joints.append(with_calibration(joint, sensor, X_WP))
        return JointBeliefs(joints=joints)
