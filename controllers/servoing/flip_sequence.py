"""The sequence of flipping a flap: approach its edge, establish contact, flip, retreat, done."""

from copy import copy
from typing import Any

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import Context

from crossmodal.controllers.arm.kinematics import ArmModel
from crossmodal.controllers.arm.sequence import Sequence, known_belief, read
from crossmodal.controllers.servoing.contact_search import twist_towards
from crossmodal.controllers.servoing.flip_config import FlipSequenceConfig
from crossmodal.controllers.servoing.flip_decisions import (
    FIRST,
    FlipPhase,
    FlipState,
    Sensed,
    next_flip_state,
)
from crossmodal.maths.arrays import Array
from crossmodal.maths.validation import check, require

_ARRIVAL_TIME = 0.5  # Time constant with which the finger arrives at a goal, [s].


def feed_forward(state: FlipState, time: float, config: FlipSequenceConfig) -> float:
    """Speed of the contact along x_S, [m/s]: rises from zero as the flip begins or goes on."""
    if state.phase != FlipPhase.FLIP:
        return 0.0
    return config.feed_speed * min((time - state.since) / config.ramp_time, 1.0)


def approach_twist(state: FlipState, touching: bool, config: FlipSequenceConfig) -> Array:
    """V_WS_S (6,) while the finger seeks a contact, along its last normal or after the edge.

    Away from the flap once it is turned.
    """
    if state.phase == FlipPhase.RETREAT:
        direction = config.retreat / np.linalg.norm(config.retreat)
        return np.concatenate([np.zeros(3), config.retreat_speed * direction])
    if touching or not state.is_seeking:
        return np.zeros(6)
    if state.X_WS_goal is not None:
        return twist_towards(state.X_WS, state.X_WS_goal, config.follow_speed, _ARRIVAL_TIME)
    first = state.phase == FlipPhase.PRE_CONTACT
    speed = config.approach_speed if first else config.search_speed
    return np.concatenate([np.zeros(3), speed * state.n_S])


def tactile_projector(phase: FlipPhase, config: FlipSequenceConfig) -> Array:
    """Diagonal (6,) of P_tact in a phase."""
    if phase >= FlipPhase.RETREAT:
        return np.zeros(6)
    flipping = phase == FlipPhase.FLIP
    return np.array(config.tactile_flip if flipping else config.tactile_establish)


def visual_projector(phase: FlipPhase, config: FlipSequenceConfig) -> Array:
    """Diagonal (6,) of P_vis in a phase."""
    if phase >= FlipPhase.RETREAT:
        return np.zeros(6)
    establishing = phase == FlipPhase.ESTABLISH_CONTACT
    return np.array(config.visual_establish if establishing else config.visual_flip)


class FlipSequence(Sequence):
    """Says which phase the flip is in, and who moves which component of the fingertip in it.

    Input ports:
    - `joint_state_measured`: (2 n,) positions [rad] and velocities [rad/s].
    - `contact_latest`: `TactileContact`.
    - `flap_angle_latest`: `FlapAngleBelief`. May stay unconnected; then the finger's own turn
      counts.
    - `hinge_latest`: `HingeBelief`. May stay unconnected; with it, an edge that is seen to have
      gone is followed.
    - `taxel_health_latest`: `StreamHealth` of the taxels; while it has an age, nothing is sought.
      May stay unconnected.
    - `force_desired`: (1,) of the contact, [N]; the configured one if not connected.
    - `feed_speed`: (1,) of the contact along x_S, [m/s]; the configured one if not connected.
    - `misalignment_seen`: (1,) of `VisualServoing`, [rad]; the finger first turns to the flap, then
      approaches it. May stay unconnected.

    Output ports:
    - `phase`: (1,) `FlipPhase`.
    - `feed_forward`: (1,) speed of the contact along x_S, [m/s].
    - `approach_twist_desired`: (6,) V_WS_S towards a contact that is not sensed, or in the end away
      from it, [rad/s, m/s].
    - `tactile_projector`: (6,) diagonal of P_tact: w_x, w_y, w_z, v_x, v_y, v_z.
    - `visual_projector`: (6,) of P_vis.
    - `failure`: str, why it failed; empty if it has not.

    State: `FlipState`.

    Frames: W world, S fingertip.

    Source: as `TactileServoing`, section IV-A.

    Args:
        config: Goal, speeds, limits, projectors.
        arm: The arm's own model, its end-effector the fingertip S.

    Raises:
        ValueError: for an impossible config value.
    """

    def __init__(self, config: FlipSequenceConfig, arm: ArmModel) -> None:
        super().__init__(arm)
        check(config, "FlipSequence")
        require(bool(np.any(config.retreat)), "FlipSequence", config, "retreat", "not all zero")
        self._config = config
        self._contact = self.DeclareAbstractInputPort("contact_latest", Value[object]())
        self._angle = self.DeclareAbstractInputPort("flap_angle_latest", Value[object]())
        self._hinge = self.DeclareAbstractInputPort("hinge_latest", Value[object]())
        self._health = self.DeclareAbstractInputPort("taxel_health_latest", Value[object]())
        self._misalignment = self.DeclareVectorInputPort("misalignment_seen", 1)
        self._settings = {
            "force": self.DeclareVectorInputPort("force_desired", 1),
            "feed_speed": self.DeclareVectorInputPort("feed_speed", 1),
        }
        self._declare_state(FIRST, config.period)
        vector, on_contact = self._declare_vector, self._on_state | {self._contact.ticket()}
        vector("phase", 1, lambda c: self._state(c).phase, self._on_state)
        on_feed = self._on_time | {self._settings["feed_speed"].ticket()}
        vector("feed_forward", 1, self._calc_feed, on_feed)
        vector("approach_twist_desired", 6, self._calc_approach, on_contact)
        state, on_state = self._state, self._on_state
        vector(
            "tactile_projector", 6, lambda c: tactile_projector(state(c).phase, config), on_state
        )
        vector("visual_projector", 6, lambda c: visual_projector(state(c).phase, config), on_state)
        self._declare_value("failure", "", lambda c: self._state(c).why, self._on_state)

    def _config_now(self, context: Context) -> FlipSequenceConfig:
        """The configuration with what is set from outside."""
        given = {name: port for name, port in self._settings.items() if port.HasValue(context)}
        if not given:
            return self._config
        config = copy(self._config)
        for name, port in given.items():
            setattr(config, name, float(port.Eval(context)[0]))
        return config

    def _calc_feed(self, context: Context) -> float:
        return feed_forward(self._state(context), context.get_time(), self._config_now(context))

    def _calc_approach(self, context: Context) -> Array:
        contact: Any = self._contact.Eval(context)
        return approach_twist(self._state(context), contact.touching, self._config)

    def _next(self, context: Context) -> FlipState:
        angle, hinge = (known_belief(port, context) for port in (self._angle, self._hinge))
        health: Any = self._health.Eval(context) if self._health.HasValue(context) else None
        now = Sensed(
            time=context.get_time(),
            X_WS=self._arm_state(context).X_WE,
            contact=self._contact.Eval(context),
            theta=float("nan") if angle is None else angle.theta,
            hinge=hinge,
            misalignment=float(read(self._misalignment, context, 0.0)[0]),
            distrust=health.fault if health is not None and health.age > 0.0 else "",
        )
        return next_flip_state(self._state(context), now, self._config_now(context))
