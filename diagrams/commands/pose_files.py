"""Points and poses as files and text, for `crossmodal pose`."""

from pathlib import Path

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from crossmodal.diagrams.run.yaml_input.schema import ScenarioError, one_line
from crossmodal.maths.arrays import Array
from crossmodal.systems.port_values import ObjectPose, PosePrior
from crossmodal.systems.pose.target_model import TargetModel

_SHOWN = 5  # Modes.


def read_points(path: Path) -> tuple[Array, Array | None]:
    """Points (N, 3) of a file and, if it has them, normals (N, 3).

    Raises:
        ScenarioError: for a file that is not there or holds no points.
    """
    if not path.is_file():
        raise ScenarioError(f"{path}: there is no such file")
    try:
        if path.suffix.lower() in (".csv", ".txt"):
            return _of_table(path)
        import trimesh

        loaded = trimesh.load(str(path))
        points = np.asarray(getattr(loaded, "vertices", np.zeros((0, 3))), dtype=float)
    except ScenarioError:
        raise
    except Exception as error:  # Each format has errors of its own.
        raise ScenarioError(f"{path}: not read as points: {one_line(error)}") from None
    if len(points) == 0:
        raise ScenarioError(f"{path}: holds no points")
    return points, None


def _of_table(path: Path) -> tuple[Array, Array | None]:
    table = pd.read_csv(path, sep=None, engine="python", skipinitialspace=True, comment="#")
    names = [str(name).strip().lower() for name in table.columns]
    if not {"x", "y", "z"} <= set(names):
        table = pd.read_csv(path, sep=None, engine="python", header=None, comment="#")
        names = ["x", "y", "z", "nx", "ny", "nz"][: len(table.columns)]
    if len(names) < 3 or not {"x", "y", "z"} <= set(names):
        raise ScenarioError(f"{path}: has {len(names)} columns, but needs x, y, z")
    table.columns = pd.Index(names + [str(k) for k in range(len(names), len(table.columns))])
    numbers = table.apply(pd.to_numeric, errors="coerce")
    points = numbers[["x", "y", "z"]].to_numpy(dtype=float)
    normals = ["nx", "ny", "nz"]
    if not set(normals) <= set(names):
        return points, None
    known = np.isfinite(numbers[["x", "y", "z", *normals]].to_numpy(dtype=float)).all(axis=1)
    return points[known], numbers[normals].to_numpy(dtype=float)[known]


def vector_option(option: str, text: str, size: int) -> Array:
    """So many numbers with commas between them."""
    try:
        values = np.array([float(part) for part in text.split(",")])
    except ValueError:
        values = np.zeros(0)
    if values.shape != (size,) or not np.isfinite(values).all():
        raise ScenarioError(f"{option} {text}: needs {size} numbers with commas between them")
    return values


def guessed(pose: Array, error: Array) -> PosePrior:
    """What `--guess` and `--guess-error` say."""
    X = np.eye(4)
    X[:3, :3], X[:3, 3] = Rotation.from_euler("xyz", pose[3:]).as_matrix(), pose[:3]
    if np.any(error <= 0.0):
        raise ScenarioError("--guess-error: both must be above zero")
    return PosePrior(X=X, rotation_sigma=float(error[1]), translation_sigma=float(error[0]))


def reported(belief: ObjectPose, model: TargetModel) -> list[str]:
    """The pose, how well it is known, and what else it may be, for people."""
    X = belief.X_WO
    position, deviation = X[:3, 3], np.sqrt(np.diag(belief.covariance))
    rotation = Rotation.from_matrix(X[:3, :3])
    (x, y, z, w), angles = rotation.as_quat(), rotation.as_euler("xyz")

    def numbers(values: Array, digits: int) -> str:
        return ", ".join(f"{value:+.{digits}f}" for value in values)

    lines = [
        f"position      ({numbers(position, 4)}) m",
        f"quaternion    ({numbers(np.array([w, x, y, z]), 4)}), w first",
        f"angles        ({numbers(np.rad2deg(angles), 2)}) deg, roll, pitch, yaw",
        f"deviations    ({', '.join(f'{1e3 * s:.2f}' for s in deviation[3:])}) mm of the object's"
        f" middle, ({', '.join(f'{np.rad2deg(s):.2f}' for s in deviation[:3])}) deg about its axes",
    ]
    if model.spins.any():
        axis = np.linalg.eigh(model.spins)[1][:, -1]
        lines.append(
            f"symmetry      turned about ({numbers(axis, 2)}) it looks the same: that angle is"
            " not known"
        )
    likely = int(np.sum(belief.probabilities > 0.01))
    lines.append(f"ambiguity     {'one pose' if likely == 1 else f'{likely} poses'} with p > 0.01")
    for X_WM, p in list(zip(belief.modes, belief.probabilities, strict=True))[:likely][:_SHOWN]:
        apart = np.linalg.norm(X_WM[:3, 3] - belief.X[:3, 3])
        turned = Rotation.from_matrix(belief.X[:3, :3].T @ X_WM[:3, :3]).magnitude()
        lines.append(
            f"  p = {p:.3f}   {1e3 * apart:.1f} mm and {np.rad2deg(turned):.1f} deg from it"
        )
    return lines
