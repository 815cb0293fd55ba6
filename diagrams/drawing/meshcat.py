"""The server that shows an episode in 3D, and what all views of one do alike."""

import socket
from collections.abc import Mapping

from pydrake.geometry import Meshcat, MeshcatParams
from pydrake.math import RigidTransform, RotationMatrix

from crossmodal.maths.arrays import Array

ROOT = "/perception"  # Of what is believed.


def start_meshcat(host: str = "localhost") -> Meshcat:
    """A Meshcat server that only this machine can reach unless `host` says otherwise.

    Raises:
        RuntimeError: where it cannot listen there.
    """
    _check_host(host)
    meshcat = Meshcat(MeshcatParams(host=host))
    for path in ("/Grid", "/Axes"):
        meshcat.SetProperty(path, "visible", False)
    return meshcat


def clear_view(meshcat: Meshcat, viewpoint: Array, looking_at: Array) -> None:
    """Removes what an earlier view may have left, and says where the page is first seen from."""
    meshcat.Delete(ROOT)
    meshcat.SetCameraPose(viewpoint, looking_at)


def legend_title(shown: str, labels: Mapping[str, str]) -> str:
    """Whose beliefs are visible at first, and where the others are switched on."""
    return f"as believed by {labels.get(shown, shown)}; others: Open Controls, Scene, perception"


def show_from(meshcat: Meshcat, path: str, time: float) -> None:
    """Makes an object appear in the recording when it was made, not before."""
    if time > 0.0:
        meshcat.SetProperty(path, "visible", False, 0.0)
    meshcat.SetProperty(path, "visible", True, time)


def rigid_transform(X: Array) -> RigidTransform:
    """X (4, 4) as Drake's type, its rotation made orthonormal again."""
    return RigidTransform(RotationMatrix.ProjectToRotationMatrix(X[:3, :3]), X[:3, 3])


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
