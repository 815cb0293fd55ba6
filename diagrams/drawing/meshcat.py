"""Starts the server that shows an episode in 3D."""

from pydrake.geometry import Meshcat, MeshcatParams


def start_meshcat(host: str = "localhost") -> Meshcat:
    """A Meshcat server that only this machine can reach unless `host` says otherwise.

    Raises:
        RuntimeError: where it cannot listen there.
    """
    meshcat = Meshcat(MeshcatParams(host=host))
    for path in ("/Grid", "/Axes"):
        meshcat.SetProperty(path, "visible", False)
    return meshcat
