"""The server that shows an episode in 3D, and what all views of one do alike."""

import socket
from collections.abc import Iterable, Mapping

import numpy as np
from pydrake.geometry import (
    GeometryId,
    Meshcat,
    MeshcatAnimation,
    MeshcatParams,
    SceneGraphInspector,
)
from pydrake.math import RigidTransform, RotationMatrix

from crossmodal.diagrams.drawing.layers import Viewpoint
from crossmodal.maths.arrays import Array
from crossmodal.maths.vectors import normal_basis

ROOT = "/perception"  # Of what is believed.
TRUTH = "/truth"  # Of what is true, hidden until somebody wants to see it.
_SCENE = "/drake/visualizer"  # Of what Drake's `MeshcatVisualizer` shows.


def start_meshcat(host: str = "localhost", port: int | None = None) -> Meshcat:
    """A Meshcat server that only this machine can reach unless `host` says otherwise.

    Args:
        host: Interface that it listens on.
        port: Of its page; the first free one from 7000 on if None.

    Raises:
        RuntimeError: where it cannot listen there.
    """
    _check_host(host)
    meshcat = Meshcat(MeshcatParams(host=host, port=port))
    for path in ("/Grid", "/Axes"):
        meshcat.SetProperty(path, "visible", False)
    return meshcat


def clear_view(meshcat: Meshcat, view: Viewpoint) -> None:
    """Removes what an earlier view may have left, and says where the page is first seen from."""
    meshcat.Delete(ROOT)
    meshcat.Delete(TRUTH)
    meshcat.SetProperty(TRUTH, "visible", False)
    meshcat.SetCameraPose(view.p_WV, view.p_WT)


def clear_player(meshcat: Meshcat) -> None:
    """Takes an ended episode's recording off the page, which would move what comes after it."""
    meshcat.SetAnimation(MeshcatAnimation())


def legend_title(shown: str, labels: Mapping[str, str]) -> str:
    """Whose beliefs are visible at first, and where the others are switched on."""
    return f"as believed by {labels.get(shown, shown)}; others, and the truth: Open Controls"


def estimator_layers(estimators: Iterable[str], labels: Mapping[str, str]) -> dict[str, str]:
    """Where each estimator's beliefs are drawn, by its label."""
    return {labels.get(name, name): f"{ROOT}/{name}" for name in estimators}


def show_from(meshcat: Meshcat, path: str, time: float) -> None:
    """Makes an object appear in the recording when it was made, not before."""
    if time > 0.0:
        meshcat.SetProperty(path, "visible", False, 0.0)
    meshcat.SetProperty(path, "visible", True, time)


def scene_path(inspector: SceneGraphInspector, geometry: GeometryId) -> str:
    """Where Drake's `MeshcatVisualizer` shows a shape of the scene."""
    frame = inspector.GetName(inspector.GetFrameId(geometry))
    return f"{_SCENE}/{frame}/{inspector.GetName(geometry)}".replace("::", "/")


class Shown:
    """What is shown at a time in the place of what was shown before.

    Attributes:
        path: Of it; empty while nothing is shown.
    """

    def __init__(self, meshcat: Meshcat) -> None:
        self._meshcat = meshcat
        self.path = ""

    def show(self, path: str, time: float) -> None:
        self.hide(time)
        self.path = path
        show_from(self._meshcat, path, time)

    def hide(self, time: float) -> None:
        if self.path:
            self._meshcat.SetProperty(self.path, "visible", False, time)
        self.path = ""


def rigid_transform(X: Array) -> RigidTransform:
    """X (4, 4) as Drake's type, its rotation made orthonormal again."""
    return RigidTransform(RotationMatrix.ProjectToRotationMatrix(X[:3, :3]), X[:3, 3])


def frame_along(z: Array) -> RotationMatrix:
    """A frame whose z is the unit vector `z` (3,)."""
    if not np.isfinite(z).all() or np.linalg.norm(z) < 0.5:
        return RotationMatrix()
    U = normal_basis(np.ascontiguousarray(z)).T
    return RotationMatrix.ProjectToRotationMatrix(
        np.column_stack([U[:, 0], np.cross(z, U[:, 0]), z])
    )


def upright_pose(p_WT: Array, viewpoint: Array) -> RigidTransform:
    """Of a board at p_WT (3,) that stands upright, its -y towards a viewer at `viewpoint` (3,)."""
    to_viewer = viewpoint - p_WT
    yaw = float(np.arctan2(-to_viewer[1], -to_viewer[0])) - 0.5 * np.pi
    return RigidTransform(RotationMatrix.MakeZRotation(yaw), p_WT)


def _check_host(host: str) -> None:
    """Raises a RuntimeError for a name that no interface of this machine has.

    Meshcat itself would wait for it for good, and could not be interrupted.
    """
    if host == "*":
        return
    try:
        addresses = socket.getaddrinfo(host, 0, type=socket.SOCK_STREAM)
    except (OSError, UnicodeError) as error:
        raise RuntimeError(f"the name is not known: {error}") from None
    for family, kind, protocol, _, address in addresses:
        try:
            with socket.socket(family, kind, protocol) as probe:
                probe.bind(address)
                return
        except OSError as error:
            reason = error
    raise RuntimeError(f"this machine has no such address: {reason}")
