"""Compares the estimators of an object's pose with registration libraries on the same clouds.

    python -m benchmarks.registration [--trials 20] [--start 30] [--seed 0]

Each trial is one view of one target, seen from 0.55 m with the depth camera's noise, and a guess of
its pose that is 2 to 5 cm off and turned by 10 to 30 deg, by a given angle, or in any way (180).
The libraries get the same points, 5000 points of the model and, where they need one, the guess.
`pip install small_gicp kiss-matcher` brings them; without one of them its rows are left out.

Columns: error of the translation and mean distance between the surfaces (ADI), median and 90 %;
the share with ADI below 5 mm; process time of one estimate, median.
"""

import importlib.util
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from time import process_time
from typing import Annotated, Any

import numpy as np
import typer
from scipy.spatial.transform import Rotation
from tqdm import tqdm

from crossmodal.diagrams.clutter.results.results import average_distance
from crossmodal.diagrams.clutter.scenario import GOODS_DIR
from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.systems.port_values import ObjectPose, PosePrior, of_mesh, of_middle
from crossmodal.systems.pose.evidence import Evidence
from crossmodal.systems.pose.pose_belief import SolverConfig, infer_pose
from crossmodal.systems.pose.quaternion_filter import QuaternionFilterConfig, filter_pose
from crossmodal.systems.pose.surface import cast_rays
from crossmodal.systems.pose.target_model import TargetModel, load_target
from crossmodal.systems.sensors.depth_noise import DepthNoiseConfig, depth_sigma

TARGETS = ("oil", "spray", "cleaner")
DISTANCE, HALF_ANGLE, RAYS = 0.55, np.deg2rad(20.0), 110  # Of the camera.
NOISE = DepthNoiseConfig()
SCALE = 100.0  # Of lengths that KISS-Matcher is given.
Method = Callable[[Evidence, PosePrior, TargetModel], Array]  # X_WO (4, 4).


def view(model: TargetModel, X_WM: Array, rng: np.random.Generator) -> Evidence:
    """What a camera sees of the object from a direction drawn above the horizon."""
    azimuth, elevation = rng.uniform(-np.pi, np.pi), np.deg2rad(rng.uniform(20.0, 60.0))
    level = np.cos(elevation) * np.array([np.cos(azimuth), np.sin(azimuth)])
    eye = X_WM[:3, 3] + DISTANCE * np.append(level, np.sin(elevation))
    X_WC = se3.looking_at(eye, X_WM[:3, 3])
    side = np.tan(HALF_ANGLE) * np.linspace(-1.0, 1.0, RAYS)
    u, v = np.meshgrid(side, side)
    rays = np.column_stack([u.ravel(), v.ravel(), np.ones(u.size)])
    length = np.linalg.norm(rays, axis=1)
    along_W = (rays / length[:, None]) @ X_WC[:3, :3].T
    R = X_WM[:3, :3]
    starts = np.ascontiguousarray(np.tile((eye - X_WM[:3, 3]) @ R, (len(rays), 1)))
    reach = np.full(len(rays), 2.0 * DISTANCE)
    found = cast_rays(starts, np.ascontiguousarray(along_W @ R), reach, model.surface, True)[0]
    met = np.isfinite(found)
    depth = found[met] / length[met]
    sigma = depth_sigma(depth, NOISE.sigma_base, NOISE.sigma_square)
    depth = depth + sigma * rng.normal(size=len(depth))
    points = eye + (depth * length[met])[:, None] * along_W[met]
    return Evidence().with_group(np.zeros((6, 0)), points, sigma, -along_W[met])


def guess(X_WM: Array, model: TargetModel, start: float, rng: np.random.Generator) -> PosePrior:
    """A pose that is 2 to 5 cm off and turned as `start` [deg] says."""
    axis, direction = rng.normal(size=(2, 3))
    angle = np.deg2rad(rng.uniform(10.0, 30.0) if start == 30.0 else start)
    X = X_WM.copy()
    X[:3, :3] = X_WM[:3, :3] @ Rotation.from_rotvec(angle * axis / np.linalg.norm(axis)).as_matrix()
    if start >= 180.0:
        X[:3, :3] = Rotation.random(random_state=int(rng.integers(2**31))).as_matrix()
    X[:3, 3] += rng.uniform(0.02, 0.05) * direction / np.linalg.norm(direction)
    known = np.deg2rad(15.0 if start <= 30.0 else start / np.sqrt(3.0))
    rotation_sigma = np.inf if start >= 180.0 else float(known)
    return PosePrior(
        X=of_mesh(X, model.middle), rotation_sigma=rotation_sigma, translation_sigma=0.025
    )


def estimator(infer: Callable[..., ObjectPose]) -> Method:
    """One of this project."""
    return lambda evidence, prior, model: infer(evidence, prior, model).X_WO


def small_gicp(kind: str, evidence: Evidence, prior: PosePrior, model: TargetModel) -> Array:
    """Iterative closest points of a kind from the guess."""
    import small_gicp as library

    samples = model.surface.points + model.middle
    start = se3.inverse(prior.X)
    for reach in (0.05, 0.01):
        result: Any = library.align(
            samples,
            evidence.points,
            init_T_target_source=start,
            registration_type=kind,
            downsampling_resolution=0.002,
            max_correspondence_distance=reach,
            num_threads=1,
        )
        start = np.array(result.T_target_source)
    return se3.inverse(start)


def kiss_matcher(evidence: Evidence, prior: PosePrior, model: TargetModel) -> Array:
    """Global registration without a guess, refined by point-to-plane."""
    import kiss_matcher as library

    # It is made for streets and takes no cells below some centimetres.
    samples = SCALE * (model.surface.points + model.middle)
    matcher: Any = library.KISSMatcher(library.KISSMatcherConfig(SCALE * 0.005))
    points = SCALE * evidence.points
    found = matcher.estimate(samples.astype(np.float32), points.astype(np.float32))
    X = np.eye(4)
    X[:3, :3], X[:3, 3] = np.array(found.rotation), np.array(found.translation) / SCALE
    return small_gicp("PLANE_ICP", evidence, replace(prior, X=X), model)


def methods(start: float) -> dict[str, Method]:
    """All that are at hand, by name."""
    found: dict[str, Method] = {
        "density": estimator(partial(infer_pose, config=SolverConfig())),
        "TIQF": estimator(partial(filter_pose, config=QuaternionFilterConfig())),
    }
    if start <= 30.0:
        one = SolverConfig(starts=0)
        found["density, one start"] = estimator(partial(infer_pose, config=one))
        alone = QuaternionFilterConfig(starts=0)
        found["TIQF, one start"] = estimator(partial(filter_pose, config=alone))
    if importlib.util.find_spec("small_gicp") is not None:
        found["small_gicp, point-to-plane"] = partial(small_gicp, "PLANE_ICP")
        found["small_gicp, GICP"] = partial(small_gicp, "GICP")
        if importlib.util.find_spec("kiss_matcher") is not None:
            found["KISS-Matcher + point-to-plane"] = kiss_matcher
    return found


def main(
    trials: Annotated[int, typer.Option(help="Views of each target.")] = 20,
    start: Annotated[float, typer.Option(help="By how much the guess is turned, deg.")] = 30.0,
    seed: Annotated[int, typer.Option(help="Of the first trial.")] = 0,
) -> None:
    """Prints a line for each method."""
    models = {name: load_target(GOODS_DIR / name / f"{name}.obj") for name in TARGETS}
    found = methods(start)
    rows: dict[str, list[tuple[float, float, float]]] = {name: [] for name in found}
    for trial in tqdm(range(seed, seed + trials)):
        rng = np.random.default_rng(trial)
        for model in models.values():
            X_WM = np.eye(4)
            X_WM[:3, :3] = Rotation.from_rotvec([0.0, 0.0, rng.uniform(-np.pi, np.pi)]).as_matrix()
            X_WM[:3, 3] = [0.5, 0.0, model.middle[2]]
            evidence, prior = view(model, X_WM, rng), guess(X_WM, model, start, rng)
            for name, method in found.items():
                began = process_time()
                X_WO = method(evidence, prior, model)
                took = process_time() - began
                X = of_middle(X_WO, model.middle)
                error = float(np.linalg.norm(X[:3, 3] - X_WM[:3, 3]))
                rows[name].append((error, average_distance(X_WM, X, model), took))
    print(f"{'':32s}{'translation, mm':>18s}{'ADI, mm':>16s}{'ADI < 5 mm':>12s}{'ms':>8s}")
    for name, values in rows.items():
        error, adi, took = np.array(values[1:]).T  # The first one of each compiles.
        cells = [
            f"{1e3 * np.median(x):8.2f} {1e3 * np.quantile(x, 0.9):7.2f}" for x in (error, adi)
        ]
        share = f"{100.0 * np.mean(adi < 0.005):10.0f} %"
        print(f"{name:32s}{cells[0]:>18s}{cells[1]:>16s}{share}{1e3 * np.median(took):8.0f}")


if __name__ == "__main__":
    typer.run(main)
