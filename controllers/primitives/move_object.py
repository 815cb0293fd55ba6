"""Grasps what stands on a table and puts it down elsewhere, or pushes it."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import Context

from crossmodal.controllers.arm.joint_motion import JointMotion, resting
from crossmodal.controllers.arm.kinematics import ArmModel
from crossmodal.controllers.arm.motion_planner import MotionPlanner
from crossmodal.controllers.primitives.action_plan import ActionPlan, ActionPlanner, Leg
from crossmodal.controllers.primitives.arm_task import ArmTask
from crossmodal.controllers.primitives.grip import (
    INWARDS,
    LOADED,
    FingerForces,
    Grip,
    finger_forces,
)
from crossmodal.controllers.primitives.move_object_config import (
    ActionEnd,
    ActionOutcome,
    ActionPhase,
    MoveObjectConfig,
)
from crossmodal.controllers.primitives.taxel_tare import TaxelTare, no_tare, tare
from crossmodal.maths.arrays import Array, Ids
from crossmodal.maths.immutable import Immutable
from crossmodal.maths.validation import check
from crossmodal.models.gripper_taxels import THICKNESS, gripper_taxels, tip_taxels

_HELD = (ActionPhase.LIFT, ActionPhase.CARRY, ActionPhase.LOWER)
_STANDS = 0.5  # Share of an object's weight that something else bears when it stands on that.


@dataclass(frozen=True, kw_only=True)
class MoveState(Immutable):
    """What is done, and how the arm moves.

    Attributes:
        motion: Of the arm.
        tare: Of the taxels.
        forces: On the taxels (140, 3) in E, averaged over a short time, [N].
        leg: What it does.
        request: That it works on.
        started: When the work on that began, [s].
        plan: Of that.
        legs: What is still to be done.
        trail: What has been done, back from where the arm is; the last one first undone.
        readings: Of the taxels (K, 420) while their offsets are taken, [N]; of a push, of the force
            on the pushing face (K,), [N].
        grip: Of the fingers.
        hanging: What the fingers carry once it is lifted (2,), along y and z of E, [N].
        touched: Of a push: how far the finger had gone when it felt the object, [m].
        felt: How far when it felt it last, [m].
        end: How this action ends, as far as that is known.
        last: How the last one ended.
        failure: Why nothing can be done any more; empty while it can.
    """

    motion: JointMotion
    tare: TaxelTare
    forces: Array
    leg: Leg = field(default_factory=lambda: Leg(phase=ActionPhase.WAIT))
    request: Any = None
    started: float = 0.0
    plan: ActionPlan | None = None
    legs: tuple[Leg, ...] = ()
    trail: tuple[Leg, ...] = ()
    readings: Array = field(default_factory=lambda: np.zeros(0))
    grip: Grip = field(default_factory=Grip)
    hanging: Array = field(default_factory=lambda: np.zeros(2))
    touched: float = np.nan
    felt: float = np.nan
    end: ActionEnd = field(default_factory=ActionEnd)
    last: ActionEnd = field(default_factory=ActionEnd)
    failure: str = ""

    @property
    def phase(self) -> ActionPhase:
        """What the arm does."""
        return self.leg.phase

    @property
    def number(self) -> int:
        """Of the request; zero before the first one."""
        return 0 if self.request is None else int(self.request.number)


class MoveObject(ArmTask):
    """Does what an `ActionRequest` wants with an object, and comes back the way it went.

    A grasp comes down along z of E, closes with a force that grows with what it carries, lifts,
    carries the object level to a place, and lowers it until it stands. A push comes down behind the
    object and goes straight on until it has pushed it far enough or does not feel it any more.

    Input ports:
    - those of `ArmTask`.
    - `action_request`: `ActionRequest`.
    - `taxel_measured`: (420,) forces on the taxels of the two-finger gripper, in E, [N].
    - `finger_position_measured`: (2,) of its fingers, 0 closed, [m].
    - `is_clear`: (1,) above 0.5 while the other arm is out of the way.

    Output ports:
    - `joint_position_commanded`: (n,), [rad].
    - `finger_position_commanded`: (2,), less than where the fingers are if they are to press, [m].
    - `action_end`: `ActionEnd` of the last action, when the arm is back.
    - `phase`: str.
    - `failure`: str, why nothing is done any more; empty while it is.
    - `is_done`: (1,) 1 when no action is wanted any more, or none can be done, and the arm rests at
      home with closed fingers.

    State: `MoveState`.

    Frames: W world, E end-effector: the middle of the fingers' ends, z along them, x along the
    opening.

    Args:
        config: Of motions and forces.
        arm: The robot's own model.
        planner: Of this arm.
        gripper: Name of the gripper's model in the planner's scene.
        q_home: Where each action begins and ends (n,), [rad].
        others: Postures (m,) of other arms that are out of the way, by the names of their models,
            [rad].
    """

    def __init__(
        self,
        config: MoveObjectConfig,
        arm: ArmModel,
        planner: MotionPlanner,
        gripper: str,
        q_home: Array,
        others: dict[str, Array],
    ) -> None:
        check(config, "MoveObject")
        super().__init__(arm, planner, config.transit, {name: len(q) for name, q in others.items()})
        self._config, self._q_home, self._away = config, q_home, others
        self._actions = ActionPlanner(planner, gripper, config)
        self._layout = layout = gripper_taxels()
        taxels = len(layout.names)
        # What a finger pushes with: what lies farther from the middle than its core.
        outside = np.abs(layout.p_FS[:, 0]) > 0.5 * THICKNESS
        self._faces = [outside & (layout.finger == finger) for finger in (0, 1)]
        self._inside = np.flatnonzero(INWARDS)
        self._tips = tip_taxels()
        self._request = self.DeclareAbstractInputPort("action_request", Value[object]())
        self._taxels = self.DeclareVectorInputPort("taxel_measured", 3 * taxels)
        self._fingers = self.DeclareVectorInputPort("finger_position_measured", 2)
        self._is_clear = self.DeclareVectorInputPort("is_clear", 1)
        first = MoveState(
            motion=resting(q_home), tare=no_tare(taxels), forces=np.zeros((taxels, 3))
        )
        self._declare_state(first, config.period)
        self._declare_command()
        self._declare_vector(
            "finger_position_commanded", 2, lambda c: self._state(c).grip.command, self._on_state
        )
        self._declare_value(
            "action_end", ActionEnd(), lambda c: self._state(c).last, self._on_state
        )
        self._declare_value("phase", "", lambda c: str(self._state(c).phase), self._on_state)
        self._declare_value("failure", "", lambda c: self._state(c).failure, self._on_state)
        self._declare_vector("is_done", 1, self._is_done)
        self._steps: dict[ActionPhase, Callable[[Context, MoveState], MoveState]] = {
            ActionPhase.WAIT: self._decide,
            ActionPhase.TARE: self._take_tare,
            ActionPhase.TRANSIT: self._come,
            ActionPhase.DESCEND: self._descend,
            ActionPhase.CLOSE: self._close,
            ActionPhase.LIFT: self._carry,
            ActionPhase.CARRY: self._carry,
            ActionPhase.LOWER: self._lower,
            ActionPhase.OPEN: self._open,
            ActionPhase.PUSH: self._push,
            ActionPhase.RETREAT: self._retreat,
        }

    def _is_done(self, context: Context) -> float:
        state: MoveState = self._state(context)
        ended = self._request.Eval(context).done or state.failure
        rests = state.phase is ActionPhase.WAIT and not state.grip.command.any()
        return float(bool(ended) and rests)

    def _next(self, context: Context) -> MoveState:
        state: MoveState = self._state(context)
        config = self._config
        now = state.tare.forces(np.asarray(self._taxels.Eval(context)))
        share = min(config.period / config.averaged, 1.0)
        state = replace(state, forces=state.forces + share * (now - state.forces))
        return self._steps[state.phase](context, self._with_fingers(context, state))

    def _with_fingers(self, context: Context, state: MoveState) -> MoveState:
        """The fingers' commands one decision later."""
        config, period = self._config.grip, self._config.period
        grip, forces = state.grip, self._finger_forces(state)
        measured = np.asarray(self._fingers.Eval(context))
        if state.phase is ActionPhase.CLOSE:
            grip = grip.closing(forces, measured, context.get_time(), period, config)
        elif state.phase in _HELD:
            grip = grip.pressing(forces, measured, period, config)
        else:
            grip = grip.moved(_opening(state), config.finger_speed * period)
        return replace(state, grip=grip)

    def _finger_forces(self, state: MoveState) -> FingerForces:
        return finger_forces(state.forces, state.tare.noise)

    def _has(self, context: Context, state: MoveState) -> bool:
        measured = np.asarray(self._fingers.Eval(context))
        return state.grip.has(self._finger_forces(state), measured, self._config.grip)

    def _holds(self, context: Context, state: MoveState) -> bool:
        slips = state.grip.slips(self._finger_forces(state), self._config.grip)
        return self._has(context, state) and not slips

    # What follows in each phase.

    def _decide(self, context: Context, state: MoveState) -> MoveState:
        wanted = self._request.Eval(context)
        if wanted.done or state.failure:
            return state
        if wanted.number > state.number:
            # It is planned before the other arms leave, so that they stay if nothing can be done.
            here = state.motion.knots[-1]
            plan = self._actions.plan(wanted, here, [self._q_home], self._away)
            end = ActionEnd(number=wanted.number)
            if plan is None:
                end = replace(end, outcome=ActionOutcome.UNREACHABLE)
                return replace(state, request=wanted, last=end)
            return replace(state, request=wanted, plan=plan, end=end)
        if state.number == state.last.number or self._is_clear.Eval(context)[0] < 0.5:
            return state
        assert state.plan is not None
        return replace(
            state,
            leg=Leg(phase=ActionPhase.TARE),
            started=context.get_time(),
            legs=state.plan.legs,
            hanging=np.zeros(2),
            readings=np.zeros((0, self._taxels.size())),
            touched=np.nan,
        )

    def _take_tare(self, context: Context, state: MoveState) -> MoveState:
        readings = np.vstack([state.readings, self._taxels.Eval(context)])
        if context.get_time() < state.started + self._config.tare_time:
            return replace(state, readings=readings)
        # The first reading was taken as the arm came to rest.
        taken = tare(readings[1:])
        if not taken.works[self._tips].all():
            silent = ", ".join(str(n) for n in self._tips[~taken.works[self._tips]])
            why = f"taxels {silent} at the fingers' end always say the same: no action is safe"
            return replace(state, leg=Leg(phase=ActionPhase.WAIT), failure=why)
        state = replace(state, tare=taken, forces=np.zeros_like(state.forces), readings=np.zeros(0))
        return self._begin(context, state)

    def _come(self, context: Context, state: MoveState) -> MoveState:
        opened = np.all(state.grip.command == _opening(state))
        return self._begin(context, state) if self._rests(context, state) and opened else state

    def _descend(self, context: Context, state: MoveState) -> MoveState:
        if state.leg.postures is None:  # It has landed.
            return self._begin(context, state) if self._rests(context, state) else state
        pressed = np.linalg.norm(state.forces[self._tips], axis=1).max() > self._config.threshold
        if pressed:
            goal = state.motion.knots[-1]
            here = state.motion.at(context.get_time())
            left = self._planner.length(np.array([here, goal]))
            assert state.plan is not None
            if left > max(state.request.landing, state.plan.spare):
                state = self._met(context, state, self._tips, np.inf)
                return self._ended(context, state, ActionOutcome.BLOCKED)
            return self._landed(context, state, here)
        return self._begin(context, state) if self._rests(context, state) else state

    def _landed(self, context: Context, state: MoveState, q: Array) -> MoveState:
        """Goes back until the fingers do not press on the table, so that they can close on it."""
        time = context.get_time()
        back = state.motion.back(time, q)
        relief = self._config.relief
        lengths = np.array([self._planner.length(back[: k + 1]) for k in range(len(back))])
        end = [np.interp(relief, lengths, joint) for joint in back.T]
        line = np.vstack([back[lengths < relief], end])
        up = self._line(line, self._config.speed, context)
        trail = (*state.trail, replace(state.leg, postures=back))
        return replace(state, leg=replace(state.leg, postures=None), motion=up, trail=trail)

    def _close(self, context: Context, state: MoveState) -> MoveState:
        config, grip = self._config.grip, state.grip
        if context.get_time() < grip.since + config.settling:
            return state
        if not self._has(context, state):
            missed = replace(state, end=replace(state.end, outcome=ActionOutcome.MISSED))
            return self._begin(context, replace(missed, legs=(Leg(phase=ActionPhase.OPEN),)))
        return self._begin(context, state)

    def _carry(self, context: Context, state: MoveState) -> MoveState:
        if not self._holds(context, state):
            return self._slipped(context, state)
        if not self._rests(context, state):
            return state
        return self._begin(context, replace(state, hanging=self._finger_forces(state).shear))

    def _slipped(self, context: Context, state: MoveState) -> MoveState:
        """Puts down what is left in the gripper, where it is or where it was lifted."""
        time, q = context.get_time(), state.motion.at(context.get_time())
        if state.phase is ActionPhase.LIFT:
            back = state.motion.back(time, q)
        else:
            assert state.plan is not None
            height, others = self._arm_state(context).X_WE[2, 3], self._others_now(context)
            back = self._actions.down(state.request, state.plan, q, height, others)
        lower = Leg(
            phase=ActionPhase.LOWER,
            postures=back,
            speed=self._config.speed,
            undoes=state.phase is ActionPhase.LIFT,
        )
        end = replace(state.end, outcome=ActionOutcome.SLIPPED)
        legs = (lower, Leg(phase=ActionPhase.OPEN))
        return self._begin(context, replace(state, legs=legs, end=end))

    def _lower(self, context: Context, state: MoveState) -> MoveState:
        # What is held hangs on the fingers along z of E; across it they may press on each other.
        weight = state.hanging[1]
        borne = weight - self._finger_forces(state).shear[1]
        stands = borne > max(_STANDS * abs(weight), self._config.grip.contact)
        outcome = state.end.outcome or ActionOutcome.PLACED
        if not stands and outcome is ActionOutcome.PLACED and not self._holds(context, state):
            outcome = ActionOutcome.SLIPPED
        elif not (stands or self._rests(context, state)):
            return state
        elif not stands and state.legs[0].phase is ActionPhase.LOWER:
            return self._begin(context, state)
        state = self._met(context, state, self._inside, 0.0)
        state = replace(state, legs=state.legs[-1:])  # That opens the gripper.
        end = replace(state.end, outcome=outcome, X_WE=self._arm_state(context).X_WE)
        return self._begin(context, replace(state, end=end))

    def _open(self, context: Context, state: MoveState) -> MoveState:
        opened = np.all(state.grip.command == _opening(state))
        return self._begin(context, state) if opened else state

    def _push(self, context: Context, state: MoveState) -> MoveState:
        config, time = self._config, context.get_time()
        assert state.plan is not None
        push = state.plan.push
        ahead = float(np.sign(state.plan.X_WE[:2, 0] @ push.direction))
        face = self._faces[0 if ahead > 0.0 else 1]
        forces = state.tare.forces(np.asarray(self._taxels.Eval(context)))
        shortest, impact, longest = (
            max(round(span / config.period), 1)
            for span in (config.averaged, config.impact, config.pushed_averaged)
        )
        readings = np.append(state.readings, -ahead * forces[face, 0].sum())[-longest:]
        noise = state.tare.noise * np.sqrt(face.sum())
        felt = any(
            readings[-count:].mean()
            > config.significance * noise * np.sqrt(1 / count + config.period / config.tare_time)
            for count in (shortest, longest)
            if len(readings) >= count
        )
        q = state.motion.at(time)
        gone = self._planner.length(np.array([state.motion.knots[0], q]))
        touched = gone if felt and np.isnan(state.touched) else state.touched
        state = replace(
            state, readings=readings, touched=touched, felt=gone if felt else state.felt
        )
        pushed = 0.0 if np.isnan(touched) else gone - touched
        outcome = ActionOutcome.NONE
        X_WCommanded = self._arm.Evaluate(np.append(q, np.zeros_like(q))).X_WE
        lag = np.linalg.norm(X_WCommanded[:3, 3] - self._arm_state(context).X_WE[:3, 3])
        is_stuck = len(readings) >= impact and readings[-impact:].min() > config.largest_push
        if is_stuck or lag > config.largest_lag:
            outcome = ActionOutcome.BLOCKED
        elif np.isnan(touched):
            if gone >= push.reach:
                outcome = ActionOutcome.MISSED
        elif gone > state.felt + config.unfelt:
            outcome, pushed = ActionOutcome.LOST, state.felt - touched
        elif pushed >= push.length or time >= state.motion.end:
            outcome = ActionOutcome.PUSHED
        if not outcome:
            return state
        if outcome is ActionOutcome.PUSHED:
            # The arm still gets to where it is commanded to be, and the object with it.
            state = self._met(context, state, np.flatnonzero(face), 0.0, X_WCommanded)
        state = replace(state, end=replace(state.end, pushed=pushed))
        return self._ended(context, state, outcome)

    def _retreat(self, context: Context, state: MoveState) -> MoveState:
        time = context.get_time()
        if time < state.motion.end:
            return state
        if state.trail:
            *trail, leg = state.trail
            if leg.phase is ActionPhase.CARRY:  # It is above the place where the object stands now.
                assert state.plan is not None
                path = self._actions.path(
                    state.request,
                    state.plan,
                    state.end.X_WE[:2, 3],
                    state.motion.knots[-1],
                    self._q_home,
                    self._others_now(context),
                )
                if path is not None:
                    return replace(state, motion=self._motion(path, context), trail=())
            motion = self._leg_motion(leg, state.motion.at(time), context)
            return replace(state, motion=motion, trail=tuple(trail))
        end = replace(state.end, seconds=time - state.started)
        return replace(state, leg=Leg(phase=ActionPhase.WAIT), last=end)

    def _met(
        self,
        context: Context,
        state: MoveState,
        taxels: Ids,
        depth: float,
        X_WE: Array | None = None,
    ) -> MoveState:
        """Adds what some of the taxels meet to the contacts, so far within an outline [m].

        Of each finger that is the middle of those that are pressed, by their forces; of a gripper
        at X_WE, or where it is.
        """
        X_WE = self._arm_state(context).X_WE if X_WE is None else X_WE
        forces = np.linalg.norm(state.forces[taxels], axis=1)
        noise = state.tare.noise * np.sqrt(self._config.period / self._config.averaged)
        weights = np.where(forces > LOADED * noise, forces, 0.0)
        measured = np.asarray(self._fingers.Eval(context))
        p_WT = X_WE[:3, 3] + self._layout.p_ET(measured)[taxels] @ X_WE[:3, :3].T
        contacts = [state.end.contacts]
        for finger in (0, 1):
            own = np.where(self._layout.finger[taxels] == finger, weights, 0.0)
            if own.sum() > 0.0:
                contacts.append(np.append(own @ p_WT[:, :2] / own.sum(), depth)[None])
        return replace(state, end=replace(state.end, contacts=np.concatenate(contacts)))

    # From one leg to the next.

    def _rests(self, context: Context, state: MoveState) -> bool:
        return bool(context.get_time() >= state.motion.end + self._transit.rest_time)

    def _ended(self, context: Context, state: MoveState, outcome: ActionOutcome) -> MoveState:
        """Stops and goes back."""
        end = replace(state.end, outcome=outcome)
        return self._begin(context, replace(state, legs=(), end=end))

    def _begin(self, context: Context, state: MoveState) -> MoveState:
        """Begins the next leg from where the arm is commanded to be, or goes back."""
        time = context.get_time()
        q = state.motion.at(time)
        trail, (leg, *rest) = state.trail, state.legs or (Leg(phase=ActionPhase.RETREAT),)
        if state.leg.postures is not None and not (state.leg.undoes or leg.undoes):
            back = state.motion.back(time, q)
            speed = max(state.leg.speed, self._config.carry_speed)
            trail = (*trail, replace(state.leg, postures=back, speed=speed))
        motion = resting(q) if leg.postures is None else self._leg_motion(leg, q, context)
        state = replace(state, leg=leg, motion=motion, trail=trail, legs=tuple(rest))
        return self._retreat(context, state) if leg.phase is ActionPhase.RETREAT else state

    def _leg_motion(self, leg: Leg, q: Array, context: Context) -> JointMotion:
        """Of a leg, from where the arm is: it may have landed before the end of the last one."""
        assert leg.postures is not None
        if leg.phase is ActionPhase.TRANSIT:
            return self._motion(leg.postures, context)
        eased = leg.phase is not ActionPhase.PUSH
        passed = int(np.argmin(np.linalg.norm(leg.postures - q, axis=1)))
        left = np.vstack([q, leg.postures[passed + 1 :]])
        return self._line(left, leg.speed, context, eased)


def _opening(state: MoveState) -> float:
    """How far each finger is to be open while nothing is held, [m]."""
    closed = state.plan is None or state.phase in (ActionPhase.WAIT, ActionPhase.TARE)
    return 0.0 if closed or state.plan is None else state.plan.opening
