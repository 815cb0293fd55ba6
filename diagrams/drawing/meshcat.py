"""Starts the server that shows an episode in 3D."""

import socket

from pydrake.geometry import Meshcat, MeshcatParams


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
