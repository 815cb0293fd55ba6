"""An object's pose from a cloud and contact points of one's own, without a robot."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from crossmodal.maths.arrays import Array
from crossmodal.systems.port_values import ObjectPose, PosePrior
from crossmodal.systems.pose.evidence import Evidence, Table
from crossmodal.systems.pose.pose_belief import SolverConfig, infer_pose
from crossmodal.systems.pose.target_model import TargetModel, load_target

GLOBAL_STARTS = 1000  # Hypotheses, where nothing is known of the pose.


def estimate_pose(
    model: TargetModel | str | Path,
    cloud: Array | None = None,
    touches: Array | None = None,
    *,
    scale: float = 1.0,
    cloud_sigma: float = 1.5e-3,
    touch_sigma: float = 1e-3,
    eye: Array | None = None,
    touch_normals: Array | None = None,
    guess: PosePrior | None = None,
    table: Table | None = None,
    config: SolverConfig | None = None,
) -> ObjectPose:
    """Where a known object is.

    Args:
        model: The object, or the file of its mesh.
        cloud: Points on it (N, 3), [m]. Rows that are not finite are left out; points of other
            objects do no harm while they are the minority.
        touches: Contact points on it (K, 3), [m].
        scale: Metres per unit of the mesh's file.
        cloud_sigma: Noise of the cloud, [m].
        touch_sigma: Noise of the contacts, [m].
        eye: Where the camera was (3,), if all points were seen from one place, [m].
        touch_normals: Unit vectors (K, 3) from which the contacts were touched.
        guess: What is known before; anything is possible if None.
        table: What the object stands on, if that is known.
        config: How hypotheses are tried.

    Returns:
        The belief, in the cloud's frame.

    Raises:
        ValueError: without any point, and for arrays of other shapes.
        TargetModelError: for a mesh that cannot be a target.
    """
    if not isinstance(model, TargetModel):
        model = load_target(model, scale)
    cloud, given = _array(cloud, "cloud"), _array(touches, "touches")
    cloud, touches = _finite(cloud), _finite(given)
    if len(cloud) + len(touches) == 0:
        raise ValueError("estimate_pose: neither cloud nor touches hold a finite point")
    facing = np.zeros_like(cloud)
    if eye is not None:
        facing = np.asarray(eye, dtype=float) - cloud
        facing /= np.linalg.norm(facing, axis=1, keepdims=True)
    normals = np.zeros_like(touches)
    if touch_normals is not None:
        normals = np.asarray(touch_normals, dtype=float)
        if normals.shape != given.shape:
            raise ValueError(
                f"estimate_pose: touch_normals are {normals.shape}, the touches {given.shape}"
            )
        normals = normals[np.isfinite(given).all(axis=1)]
        normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    known_exactly = np.zeros((6, 0))
    evidence = Evidence(table=table).with_group(known_exactly, cloud, cloud_sigma, facing)
    evidence = evidence.with_group(known_exactly, touches, touch_sigma, normals)
    config = config or SolverConfig()
    if guess is None:
        X = np.eye(4)
        X[:3, 3] = np.median(evidence.points, axis=0) - model.middle
        guess = PosePrior(X=X, rotation_sigma=np.inf, translation_sigma=np.inf)
        config = replace(config, starts=max(config.starts, GLOBAL_STARTS))
    return infer_pose(evidence, guess, model, config)


def _array(values: Array | None, name: str) -> Array:
    points = np.zeros((0, 3)) if values is None else np.asarray(values, dtype=float)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"estimate_pose: {name} is {points.shape}, but it must be (N, 3)")
    return points


def _finite(points: Array) -> Array:
    return np.ascontiguousarray(points[np.isfinite(points).all(axis=1)])
