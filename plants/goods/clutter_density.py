"""How dense clutter is: how much of a target others hide, and what touches what."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from pydrake.geometry import (
    ClippingRange,
    ColorRenderCamera,
    MakeRenderEngineVtk,
    RenderCameraCore,
    RenderEngineVtkParams,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.sensors import CameraInfo

from crossmodal.maths.arrays import Array
from crossmodal.plants.goods.goods_scene import GoodsScene

# What only the renderer of that name shows, it shows: a transparent object hides, too.
_RENDERER = "colour"
_AWAY, _FIELD, _PIXELS = 1.5, np.deg2rad(22.0), 320  # Of the views; a pixel is 2 mm wide.
_AZIMUTHS = 8
_TOUCHING = 1e-3  # Largest distance of what touches, [m].
_HIDDEN = RigidTransform(np.array([0.0, 0.0, -50.0]))


@dataclass(frozen=True, kw_only=True)
class ClutterDensity:
    """How dense clutter is.

    What hides is any other object, a transparent one, too.

    Attributes:
        hidden_above: Share of the target's image, seen from above, that others hide, 0 to 1.
        hidden_60: The same from an elevation of 60 deg, mean over eight azimuths.
        hidden_35: The same from 35 deg.
        touching: Pairs of objects nearer than 1 mm to each other.
        touching_target: Those with the target.
    """

    hidden_above: float = 0.0
    hidden_60: float = 0.0
    hidden_35: float = 0.0
    touching: int = 0
    touching_target: int = 0


NO_DENSITY = ClutterDensity()


def measure_density(poses: Mapping[str, RigidTransform], target: str) -> ClutterDensity:
    """How much of a target others hide, and what touches, in a scene of goods.

    Args:
        poses: X_WO by the names of models in models/sdf/goods; W is on the table's top, z up.
        target: One of them.

    Raises:
        ValueError: if the target is not among the objects, or a name is not known.
    """
    if target not in poses:
        raise ValueError(f"no target '{target}' in the scene; there are {', '.join(poses)}")
    scene = GoodsScene(list(poses), poses[target].translation() * [1.0, 1.0, 0.0])
    scene.scene_graph.AddRenderer(
        scene.scene_graph.GetMyMutableContextFromRoot(scene.context),
        _RENDERER,
        MakeRenderEngineVtk(RenderEngineVtkParams()),
    )  # Before any pose is read, or its first images are of other poses.
    scene.place(poses)
    touching = scene.distances(_TOUCHING)
    middle = poses[target] @ scene.bodies[target].default_com()
    views = {
        elevation: [
            _look_at(middle, np.deg2rad(elevation), 2.0 * np.pi * k / _AZIMUTHS)
            for k in range(_AZIMUTHS if elevation < 90 else 1)
        ]
        for elevation in (90, 60, 35)
    }
    beside = _areas(scene, target, views)
    scene.place({name: _HIDDEN for name in poses if name != target})
    alone = _areas(scene, target, views)
    hidden = {e: float(np.mean(1.0 - beside[e] / alone[e])) for e in views}
    return ClutterDensity(
        hidden_above=hidden[90],
        hidden_60=hidden[60],
        hidden_35=hidden[35],
        touching=len(touching),
        touching_target=sum(target in pair for pair in touching),
    )


def nearer_than(poses: Mapping[str, RigidTransform], target: str, distance: float) -> list[str]:
    """Names of the objects that are nearer to a target than that [m], in order.

    Args:
        poses: X_WO by the names of models in models/sdf/goods.
        target: One of them.
        distance: Between surfaces, above zero, [m].
    """
    scene = GoodsScene(list(poses), poses[target].translation() * [1.0, 1.0, 0.0])
    scene.place(poses)
    near = {name for pair in scene.distances(distance) if target in pair for name in pair}
    return sorted(near - {target})


def _look_at(p_WMiddle: Array, elevation: float, azimuth: float) -> RigidTransform:
    """X_WC of a camera that looks at a point, z forward and y down or towards the horizon."""
    z = -np.array(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ]
    )
    x = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    R_WC = RotationMatrix(np.column_stack([x, np.cross(z, x), z]))
    return RigidTransform(R_WC, p_WMiddle - _AWAY * z)


def _areas(
    scene: GoodsScene, target: str, views: Mapping[int, list[RigidTransform]]
) -> dict[int, Array]:
    """How many pixels show the target in each view."""
    query = scene.query()
    focal = 0.5 * _PIXELS / np.tan(0.5 * _FIELD)
    core = RenderCameraCore(
        _RENDERER,
        CameraInfo(_PIXELS, _PIXELS, focal, focal, 0.5 * _PIXELS, 0.5 * _PIXELS),
        ClippingRange(0.1, 5.0),
        RigidTransform(),
    )
    camera = ColorRenderCamera(core)
    world = scene.scene_graph.world_frame_id()
    label = int(scene.bodies[target].index())
    return {
        elevation: np.array(
            [
                np.count_nonzero(query.RenderLabelImage(camera, world, X_WC).data == label)
                for X_WC in cameras
            ],
            dtype=float,
        )
        for elevation, cameras in views.items()
    }
