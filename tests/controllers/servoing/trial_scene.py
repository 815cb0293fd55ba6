"""A fingertip on a gantry at the free edge of a hinged flap, without arms, hands or camera."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import (
    AddMultibodyPlant,
    ContactResults,
    ExternallyAppliedSpatialForce,
    MultibodyPlant,
    MultibodyPlantConfig,
)
from pydrake.multibody.tree import FixedOffsetFrame, PdControllerGains
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import BasicVector, Context, DiagramBuilder, LeafSystem, State

from crossmodal.controllers.servoing.flip_decisions import FlipPhase
from crossmodal.diagrams.flap.flip_control import FlipControlConfig, make_flip_control
from crossmodal.maths.arrays import Array
from crossmodal.systems.port_values import FlapAngleBelief, HingeBelief
from crossmodal.systems.sensors.randomness import WhiteNoise
from crossmodal.systems.tactile.taxel_layout import SEMI_AXES, fingertip_layout

K_W = np.array([0.0, -1.0, 0.0])  # Axis of the hinge, through the world's origin.
GAP = 0.004  # Between fingertip and edge at the start, [m].
SKIN = 0.0025  # Width over which the skin spreads pressure, [m].
LAYOUT = fingertip_layout()
_INERTIA = (
    "<inertial><mass>{m}</mass><inertia><ixx>{i}</ixx><iyy>{i}</iyy><izz>{i}</izz>"
    "<ixy>0</ixy><ixz>0</ixz><iyz>0</iyz></inertia></inertial>"
)
_STAGES = [("prismatic", "1 0 0"), ("prismatic", "0 1 0"), ("prismatic", "0 0 1")]
_TURNS = [("revolute", "1 0 0"), ("revolute", "0 1 0"), ("revolute", "0 0 1")]


def no_jerk(time: float) -> Array:
    return np.zeros(3)


@dataclass(kw_only=True)
class Trial:
    """What a trial varies."""

    control: FlipControlConfig = field(default_factory=FlipControlConfig)
    noise: float = 0.01  # Of a taxel, [N].
    latency: float = 0.02  # Of the taxels, [s].
    seed: int = 0
    vision: bool = False  # Whether the flap's angle is known.
    hinge_known: bool = False
    known_from: float = -1.0  # Angle of the flap above which either is, [rad].
    vision_bias: float = 0.0  # [rad]
    blind_from: float = np.inf  # From then on the last angle is believed, [s].
    friction: float = 0.7
    coulomb: float = 0.008  # Of the hinge, [N m].
    thickness: float = 0.006  # Of the flap, [m].
    length: float = 0.085  # From the hinge to the free edge, [m].
    misplaced: float = 0.0  # Of the finger along x at the start, [m].
    hinge_offset: float = 0.0  # Of the flap's middle plane from the hinge, [m].
    yaw: float = 0.0  # Of the finger about its y at the start, [rad].
    tilt: float = 0.0  # Of the finger about its x at the start, [rad].
    roll: float = 0.0  # Of the finger about its z at the start, [rad].
    step: float = 0.002  # [s]
    stiffness: float = 2e4  # Of the gantry's rails, [N/m].
    jerk: Callable[[float], Array] = no_jerk  # Shift of the hinge (3,) over time, [m].
    swing: tuple[float, float, float] = (0.0, 0.0, 0.0)  # Of the flap: from [s], to [s], [rad/s].


def _joint(name: str, kind: str, axis: str, parent: str, child: str, limit: float = 4.0) -> str:
    return (
        f'<joint name="{name}" type="{kind}"><parent>{parent}</parent><child>{child}</child>'
        f"<axis><xyz>{axis}</xyz><limit><lower>-{limit}</lower><upper>{limit}</upper>"
        "<velocity>3</velocity><effort>10000</effort></limit></axis></joint>"
    )


def _stages(name: str, joints: list[tuple[str, str]], last: str) -> str:
    """Light bodies one after the other, the last one with what `last` adds to it."""
    text, parent = "", f"{name}_base"
    text += f'<link name="{parent}">{_INERTIA.format(m=0.2, i=1e-4)}</link>'
    for index, (kind, axis) in enumerate(joints):
        child = f"{name}_{index}"
        inner = last if index == len(joints) - 1 else ""
        text += f'<link name="{child}">{_INERTIA.format(m=0.2, i=1e-4)}{inner}</link>'
        text += _joint(f"{name}_joint_{index}", kind, axis, parent, child)
        parent = child
    return f'<sdf version="1.9"><model name="{name}">{text}</model></sdf>'


def gantry(trial: Trial) -> str:
    """A fingertip on three rails and three turns about its own x, y and z."""
    radii = " ".join(str(axis) for axis in SEMI_AXES)
    pad = (
        f'<collision name="pad"><geometry><ellipsoid><radii>{radii}</radii></ellipsoid></geometry>'
        "<drake:proximity_properties xmlns:drake='drake'><drake:compliant_hydroelastic/>"
        "<drake:hydroelastic_modulus>3e5</drake:hydroelastic_modulus>"
        "<drake:mesh_resolution_hint>0.005</drake:mesh_resolution_hint>"
        "<drake:hunt_crossley_dissipation>5</drake:hunt_crossley_dissipation>"
        f"<drake:mu_dynamic>{trial.friction}</drake:mu_dynamic>"
        f"<drake:mu_static>{trial.friction}</drake:mu_static>"
        "</drake:proximity_properties></collision>"
    )
    return _stages("gantry", _STAGES + _TURNS, pad)


def tool(trial: Trial) -> str:
    """A flap that hangs from a hinge on three rails."""
    size = f"{trial.thickness} 0.2 {trial.length - 0.006}"
    place = f"{trial.hinge_offset} 0 {-0.5 * (trial.length + 0.006)} 0 0 0"
    flap = (
        f'<link name="flap">{_INERTIA.format(m=0.15, i=4e-4)}<collision name="plate">'
        f"<pose>{place}</pose><geometry><box><size>{size}</size></box></geometry>"
        "<drake:proximity_properties xmlns:drake='drake'><drake:rigid_hydroelastic/>"
        f"<drake:mu_dynamic>{trial.friction}</drake:mu_dynamic>"
        f"<drake:mu_static>{trial.friction}</drake:mu_static>"
        "</drake:proximity_properties></collision></link>"
        + _joint("hinge", "revolute", " ".join(map(str, K_W)), "tool_2", "flap")
    )
    return _stages("tool", _STAGES, "").replace("</model>", flap + "</model>")


def start_pose(trial: Trial) -> RigidTransform:
    """X_WS before the edge, y_S towards the hinge but for the trial's errors."""
    R_WS = RotationMatrix(np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]))
    error = (
        RotationMatrix.MakeXRotation(trial.tilt)
        @ RotationMatrix.MakeYRotation(trial.yaw)
        @ RotationMatrix.MakeZRotation(trial.roll)
    )
    return RigidTransform(
        R_WS @ error,
        [trial.hinge_offset + trial.misplaced, 0.0, -trial.length - SEMI_AXES[1] - GAP],
    )


def add_gantry(plant: MultibodyPlant, trial: Trial) -> None:
    (index,) = Parser(plant).AddModelsFromString(gantry(trial), "sdf")
    base = plant.GetFrameByName("gantry_base", index)
    plant.WeldFrames(plant.world_frame(), base, start_pose(trial))
    tip = plant.GetFrameByName("gantry_5", index)
    plant.AddFrame(FixedOffsetFrame("end_effector", tip, RigidTransform()))


def gantry_model(trial: Trial) -> MultibodyPlant:
    """What the gantry's control knows of it."""
    plant = MultibodyPlant(0.0)
    add_gantry(plant, trial)
    plant.Finalize()
    return plant


def add_drives(plant: MultibodyPlant, trial: Trial) -> None:
    for name, count in (("gantry", 6), ("tool", 3)):
        for index in range(count):
            joint = plant.GetJointByName(f"{name}_joint_{index}")
            actuator = plant.GetJointActuatorByName(f"{name}_joint_{index}")
            p = trial.stiffness if index < 3 else 400.0
            d = 2.0 * np.sqrt(p) if index < 3 else 2.0
            assert joint is not None
            actuator.set_controller_gains(PdControllerGains(p=p, d=d))
    hinge = plant.GetJointActuatorByName("hinge")
    hinge.set_effort_limit(trial.coulomb)
    hinge.set_controller_gains(PdControllerGains(p=0.0, d=20.0))


@dataclass(kw_only=True)
class Touch:
    """The true contact: taxels' forces (12,), force [N], centre of pressure p_SC, normal in S."""

    taxels: Array
    force: float = 0.0
    p_SC: Array = field(default_factory=lambda: np.full(3, np.nan))
    n_S: Array = field(default_factory=lambda: np.full(3, np.nan))


def touch_of(results: ContactResults, X_WS: RigidTransform) -> Touch:
    """The pressure of each face, spread by the skin to the taxels."""
    points, forces, normals = [], [], []
    for i in range(results.num_hydroelastic_contacts()):
        surface = results.hydroelastic_contact_info(i).contact_surface()
        field_ = surface.poly_e_MN() if not surface.is_triangle() else surface.tri_e_MN()
        for face in range(surface.num_faces()):
            p = surface.centroid(face)
            points.append(p)
            forces.append(field_.EvaluateCartesian(face, p) * surface.area(face))
            normals.append(surface.face_normal(face))
    if not points:
        return Touch(taxels=np.zeros(12))
    f = np.array(forces)
    p_S = X_WS.inverse().multiply(np.array(points).T).T
    n_S = X_WS.rotation().inverse().multiply(np.array(normals).T).T
    n_S *= np.sign(np.sum(n_S * p_S, axis=1))[:, None]
    square = np.sum((p_S[:, None] - LAYOUT.p_ST[None]) ** 2, axis=2)
    share = np.exp(-0.5 * square / SKIN**2)
    share /= np.exp(-0.5 * 2.5**2) + share.sum(axis=1, keepdims=True)
    middle = np.exp(-0.5 * np.sum((LAYOUT.p_ST - LAYOUT.p_ST.mean(axis=0)) ** 2, axis=1) / SKIN**2)
    middle /= np.exp(-0.5 * 2.5**2) + middle.sum()
    share /= np.linalg.norm(middle @ LAYOUT.n_S)
    total = float(f.sum())
    if not total > 0.0:
        return Touch(taxels=np.zeros(12))
    n = f @ n_S
    return Touch(taxels=f @ share, force=total, p_SC=f @ p_S / total, n_S=n / np.linalg.norm(n))


class Sensors(LeafSystem):
    """Joints and taxels at 100 Hz, the latter late and noisy; keeps the truth of each sample."""

    def __init__(self, plant: MultibodyPlant, trial: Trial) -> None:
        super().__init__()
        self._plant, self._scratch = plant, plant.CreateDefaultContext()
        self._gantry = plant.GetModelInstanceByName("gantry")
        self._trial, self._noise = trial, WhiteNoise(trial.seed, "taxels", 12)
        self.log: list[tuple[float, Array, float, Touch]] = []
        self._state_in = self.DeclareVectorInputPort("state", plant.num_multibody_states())
        self._contacts = self.DeclareAbstractInputPort(
            "contacts", AbstractValue.Make(ContactResults())
        )
        self._late = round(trial.latency / 0.01)
        self.DeclareDiscreteState(np.zeros(12 * (self._late + 1)))
        joints = self.DeclareDiscreteState(np.zeros(12))
        self.DeclareVectorOutputPort(
            "taxel_measured", 12, self._calc_taxels, prerequisites_of_calc={self.xd_ticket()}
        )
        self.DeclareStateOutputPort("joint_state_measured", joints)
        shown = {self._state_in.ticket()}
        self.DeclareAbstractOutputPort("angle", lambda: Value[object](), self._calc_angle, shown)
        self.DeclareAbstractOutputPort("hinge", lambda: Value[object](), self._calc_hinge, shown)
        self.DeclarePeriodicUnrestrictedUpdateEvent(0.01, 0.0, self._sample)

    def _calc_taxels(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(context.get_discrete_state(0).value()[-12:])

    def _posture(self, context: Context) -> Context:
        self._plant.SetPositionsAndVelocities(self._scratch, self._state_in.Eval(context))
        return self._scratch

    def _theta(self, context: Context) -> tuple[float, float]:
        posture, hinge = self._posture(context), self._plant.GetJointByName("hinge")
        return hinge.get_angle(posture), hinge.get_angular_rate(posture)

    def _calc_angle(self, context: Context, output: Value) -> None:
        theta, rate = self._theta(context)
        spread = 1e-4
        if context.get_time() > self._trial.blind_from:
            spread = 1.0
            theta = next(seen for time, _, seen, _ in self.log if time >= self._trial.blind_from)
        seen = theta + self._trial.vision_bias
        output.set_value(
            FlapAngleBelief(
                known=self._trial.vision and theta > self._trial.known_from,
                theta=theta,
                variance=1e-4,
                rate=rate,
                n_W=np.array([np.cos(seen), 0.0, np.sin(seen)]),
                n_covariance=spread * np.eye(3),
            )
        )

    def _calc_hinge(self, context: Context, output: Value) -> None:
        output.set_value(
            HingeBelief(
                known=self._trial.hinge_known and self._theta(context)[0] > self._trial.known_from,
                k_W=K_W,
                p_WK=self._trial.jerk(context.get_time()),
                covariance=1e-6 * np.eye(6),
            )
        )

    def _sample(self, context: Context, state: State) -> None:
        posture, plant = self._posture(context), self._plant
        X_WS = plant.GetFrameByName("end_effector").CalcPoseInWorld(posture)
        touch = touch_of(self._contacts.Eval(context), X_WS)
        theta, _ = self._theta(context)
        time = context.get_time()
        self.log.append((time, X_WS.GetAsMatrix4(), theta, touch))
        sample = touch.taxels + self._trial.noise * self._noise(round(time / 0.01))
        sample[sample < 0.03] = 0.0
        ring = state.get_mutable_discrete_state().get_mutable_value(0)
        ring[:] = np.concatenate([sample, ring[:-12]])
        joints = np.concatenate(
            [
                plant.GetPositions(posture, self._gantry),
                plant.GetVelocities(posture, self._gantry),
            ]
        )
        state.get_mutable_discrete_state().get_mutable_value(1)[:] = joints


class Swing(LeafSystem):
    """A hand that swings the flap for a while, away from the finger."""

    def __init__(self, plant: MultibodyPlant, trial: Trial) -> None:
        super().__init__()
        self._start, self._end, self._rate = trial.swing
        hinge = plant.GetJointByName("hinge")
        self._flap = plant.GetBodyByName("flap").index()
        self._speed = plant.num_positions() + hinge.velocity_start()
        self._in = self.DeclareVectorInputPort("state", plant.num_multibody_states())
        self.DeclareAbstractOutputPort(
            "force", lambda: Value[list[ExternallyAppliedSpatialForce]](), self._calc
        )

    def _calc(self, context: Context, output: Value) -> None:
        force = ExternallyAppliedSpatialForce()
        force.body_index = self._flap
        swung = self._start <= context.get_time() < self._end
        torque = 0.05 * (self._rate - self._in.Eval(context)[self._speed]) * swung
        force.F_Bq_W = SpatialForce(torque * K_W, np.zeros(3))
        output.set_value([force])


class Shift(LeafSystem):
    """Desired positions and velocities of the tool's rails and its hinge."""

    def __init__(self, trial: Trial) -> None:
        super().__init__()
        self._jerk = trial.jerk
        self.DeclareVectorOutputPort("desired", 8, self._calc)

    def _calc(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(np.concatenate([self._jerk(context.get_time()), np.zeros(5)]))


class Hold(LeafSystem):
    """Desired positions and velocities of the gantry from commanded positions."""

    def __init__(self, size: int) -> None:
        super().__init__()
        self._in = self.DeclareVectorInputPort("positions", size)
        self.DeclareVectorOutputPort("desired", 2 * size, self._calc)

    def _calc(self, context: Context, output: BasicVector) -> None:
        q = np.asarray(self._in.Eval(context))
        output.SetFromVector(np.concatenate([q, 0.0 * q]))


@dataclass(kw_only=True)
class Outcome:
    """What happened: times (K,), poses (K, 4, 4), angles (K,), touches (K,), phases (K,)."""

    times: Array
    X_WS: Array
    theta: Array
    touches: list[Touch]
    phases: Array
    failure: str

    def of(self, name: str) -> Array:
        return np.array([getattr(touch, name) for touch in self.touches])


def simulate(trial: Trial, seconds: float) -> Outcome:
    """The trial until the flap is turned or the flip has failed, or for so many seconds."""
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlant(
        MultibodyPlantConfig(
            time_step=trial.step,
            contact_model="hydroelastic_with_fallback",
            discrete_contact_approximation="lagged",
            contact_surface_representation="polygon",
        ),
        builder,
    )
    add_gantry(plant, trial)
    (index,) = Parser(plant).AddModelsFromString(tool(trial), "sdf")
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("tool_base", index))
    plant.mutable_gravity_field().set_gravity_vector([0.0, 0.0, 0.0])
    add_drives(plant, trial)
    plant.Finalize()
    sensors = builder.AddNamedSystem("sensors", Sensors(plant, trial))
    control = builder.AddSystem(
        make_flip_control(trial.control, gantry_model(trial), LAYOUT, np.zeros(6))
    )
    shift = builder.AddSystem(Shift(trial))
    swing = builder.AddSystem(Swing(plant, trial))
    builder.Connect(plant.get_state_output_port(), swing.get_input_port())
    builder.Connect(swing.get_output_port(), plant.get_applied_spatial_force_input_port())
    hold = builder.AddSystem(Hold(6))
    builder.Connect(plant.get_state_output_port(), sensors.GetInputPort("state"))
    builder.Connect(plant.get_contact_results_output_port(), sensors.GetInputPort("contacts"))
    for name in ("taxel_measured", "joint_state_measured"):
        builder.Connect(sensors.GetOutputPort(name), control.GetInputPort(name))
    builder.Connect(sensors.GetOutputPort("angle"), control.GetInputPort("flap_angle_latest"))
    builder.Connect(sensors.GetOutputPort("hinge"), control.GetInputPort("hinge_latest"))
    builder.Connect(control.GetOutputPort("joint_position_commanded"), hold.get_input_port())
    for name, system in (("gantry", hold), ("tool", shift)):
        instance = plant.GetModelInstanceByName(name)
        builder.Connect(system.get_output_port(), plant.get_desired_state_input_port(instance))
    diagram = builder.Build()
    simulator = Simulator(diagram)
    phases: list[float] = []
    phase = control.GetOutputPort("phase")
    simulator.Initialize()
    while simulator.get_context().get_time() < seconds - 1e-9:
        context = control.GetMyContextFromRoot(simulator.get_context())
        phases.append(float(phase.Eval(context)[0]))
        simulator.AdvanceTo(round(simulator.get_context().get_time() + 0.01, 6))
        if phases[-1] >= FlipPhase.RETREAT:
            break
    context = control.GetMyContextFromRoot(simulator.get_context())
    count = min(len(phases), len(sensors.log))
    times, poses, theta, touches = zip(*sensors.log[:count], strict=True)
    return Outcome(
        times=np.array(times),
        X_WS=np.array(poses),
        theta=np.array(theta),
        touches=list(touches),
        phases=np.array(phases[:count]),
        failure=str(control.GetOutputPort("failure").Eval(context)),
    )
