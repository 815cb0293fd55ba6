"""Where a user's object stands before the arm, so that the hand gets to its handle."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import trimesh
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from trimesh.intersections import slice_mesh_plane

from crossmodal.controllers.arm.inverse_kinematics import all_inverse_kinematics
from crossmodal.diagrams.crossmodal.objects.object_model import ObjectModel, parse_alone
from crossmodal.diagrams.crossmodal.robot_config import ARM, ControlConfig
from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.plants.object_import.solids import solid_of
from crossmodal.plants.robots.arm_with_hand import make_arm_with_load
from crossmodal.plants.robots.wam import WAM_WITH_SOFT_HAND
from crossmodal.plants.scene import facing, has_model, nominal_pose

_ROBOT = 0.25  # Half width of the space around the arm's base that is left to it, [m].
_RESTARTS, _SPREAD, _NEAR = 16, 0.6, 0.2  # Of searches for a posture and for one near it, [rad].
_SHOWN = 0.01  # Least distance that is spoken of, [m].


@dataclass(kw_only=True)
class Place:
    """Where an object stands.

    Attributes:
        scene: File of model directives.
        X_WH: Pose of its handle.
        posture: Of the arm at the handle (7,), [rad].
        raised: How far it is above what it stands on, [m].
        reason: Why not where the scenario's own object is; empty where it is there.
    """

    scene: str
    X_WH: RigidTransform
    posture: Array
    raised: float
    reason: str

    def __str__(self) -> str:
        on = f"on the {_base(self.scene)}"
        if self.raised > _SHOWN:
            on = f"{100 * self.raised:.0f} cm above the {_base(self.scene)}"
        return f"{on}, its handle at {_listed(self.X_WH.translation())} m"


def find_place(
    facts: ObjectModel,
    model: Path,
    X_WH: RigidTransform,
    grounds: Mapping[str, float],
    control: ControlConfig,
    wanted: float,
    *,
    sway: float,
) -> Place:
    """The first of some scenes in which the arm gets to an object's handle and along its way.

    Where it gets along the way in none of them, it is the first in which it gets to the handle.

    The object is raised until its handle is as high as the scenario's own. Where the arm gets to it
    in no scene, a handle that is higher than that comes closer, so that it is no farther from the
    arm's shoulder.

    Args:
        facts: About the object.
        model: Its file.
        X_WH: The scenario's own handle.
        grounds: Of scenes the least height of what stands there, [m].
        control: With the posture from which the search begins.
        wanted: How far the task asks the joint to go, [m or rad].
        sway: Half range of the height by which a seed moves the object, [m].

    Raises:
        ValueError: in one line, where the arm gets to it in none of them.
    """
    try:
        return _first(facts, model, X_WH, grounds, control, facts.twist_H * wanted, sway)
    except ValueError as error:
        reason = str(error)
    place = _first(facts, model, X_WH, grounds, control, np.zeros(6), sway)
    return replace(place, reason=f"{reason}; so it may end short of it")


def _first(
    facts: ObjectModel,
    model: Path,
    X_WH: RigidTransform,
    grounds: Mapping[str, float],
    control: ControlConfig,
    xi_H: Array,
    sway: float,
) -> Place:
    """As `find_place`, of those from which the arm gets along a way, a twist of the handle (6,)."""
    solid, height = _touched(model), float(facts.X_OH.translation()[2]) - facts.bottom
    there, reasons = X_WH.translation(), list[str]()
    for closer in (False, True):
        for scene, ground in grounds.items():
            X_WBase = nominal_pose(scene, "base", ARM)
            arm = make_arm_with_load(WAM_WITH_SOFT_HAND, X_WBase)
            p_WH = np.array([*there[:2], max(there[2], ground + sway + height)])
            if closer:
                p_WH = _as_far(there, p_WH, arm)
            X_WHandle = RigidTransform(_upright(facts.X_OH.rotation(), X_WH), p_WH)
            X_BaseO = X_WBase.inverse() @ X_WHandle @ facts.X_OH.inverse()
            if _is_met(solid, X_BaseO):
                fault = "it would stand in the robot"
            else:
                q = _posture(arm, X_WHandle, xi_H, control)
                if q is not None:
                    raised = float(p_WH[2]) - height - ground - sway
                    return Place(
                        scene=scene,
                        X_WH=X_WHandle,
                        posture=q,
                        raised=raised,
                        reason="; ".join(dict.fromkeys(reasons)),
                    )
                fault = "the arm does not get to its handle"
                fault += " and along its way" if np.any(xi_H) else ""
            reasons.append(f"on the {_base(scene)}, the handle at {_listed(p_WH)} m, {fault}")
    raise ValueError("; ".join(dict.fromkeys(reasons)))


def _base(scene: str) -> str:
    return "table" if has_model(scene, "table") else "floor"


def _listed(p_W: Array) -> str:
    return ", ".join(f"{value:.2f}" for value in p_W)


def _touched(model: Path) -> trimesh.Trimesh:
    """What of an object can be touched, in its model's frame."""
    plant, scene_graph, instance = parse_alone(model, "--object")
    plant.Finalize()
    bodies = [plant.get_body(index) for index in plant.GetBodyIndices(instance)]
    frame = plant.GetFrameByName("__model__", instance)
    context = plant.CreateDefaultContext()
    return solid_of(plant, scene_graph.model_inspector(), context, bodies, frame)


def _upright(R_OH: RotationMatrix, X_WH: RigidTransform) -> RotationMatrix:
    """Orientation of an upright object's handle whose x points where another's does, from above."""
    (x, y, _), (x_W, y_W, _) = R_OH.col(0), X_WH.rotation().col(0)
    heading = np.arctan2(y, x) if np.hypot(x, y) > 0.1 else 0.0
    return RotationMatrix.MakeZRotation(np.arctan2(y_W, x_W) - heading) @ R_OH


def _as_far(p_WH: Array, p_WHigher: Array, arm: MultibodyPlant) -> Array:
    """The place (3,) below or above a second one that is as far from the shoulder as the first.

    One that is too high for that, or nearer already, stays where it is.
    """
    shoulder = arm.GetJointByName("joint_2").frame_on_parent()
    p_WS = shoulder.CalcPoseInWorld(arm.CreateDefaultContext()).translation()
    out, rise = p_WH - p_WS, p_WHigher[2] - p_WS[2]
    share = np.sqrt(max(out @ out - rise**2, 0.0)) / np.linalg.norm(out[:2])
    share = share if 0.0 < share < 1.0 else 1.0
    return np.array([*(p_WS[:2] + share * out[:2]), p_WHigher[2]])


def _is_met(solid: trimesh.Trimesh, X_BaseO: RigidTransform) -> bool:
    """Whether an object reaches into the space above and below the arm's base."""
    rest = solid.copy().apply_transform(X_BaseO.GetAsMatrix4())
    for normal in (np.array([1.0, 0, 0]), np.array([0, 1.0, 0])):
        for sign in (1.0, -1.0):
            if not rest.is_empty:
                rest = slice_mesh_plane(rest, sign * normal, -sign * _ROBOT * normal)
    return not rest.is_empty


def _posture(
    arm: MultibodyPlant, X_WH: RigidTransform, xi_H: Array, control: ControlConfig
) -> Array | None:
    """A posture (7,) at a handle from which the arm gets before it and to the end of its way.

    There the hand may have turned with the handle, or on it.
    """
    before = RigidTransform([0.0, 0.0, -control.sequence.approach_distance])
    X_WEnd = X_WH @ RigidTransform(se3.exp(xi_H))
    X_WTurned = RigidTransform(X_WH.rotation(), X_WEnd.translation())
    needed = [[facing(X_WH) @ before], [facing(X_WEnd), facing(X_WTurned)]]
    for q in all_inverse_kinematics(arm, facing(X_WH), [control.posture], _RESTARTS, _SPREAD):
        if all(any(_is_near(arm, X_WE, q) for X_WE in either) for either in needed):
            return q
    return None


def _is_near(arm: MultibodyPlant, X_WE: RigidTransform, q: Array) -> bool:
    """Whether the arm gets to a pose from a posture (7,) without a large detour."""
    return any(True for _ in all_inverse_kinematics(arm, X_WE, [q], _RESTARTS, _NEAR))
