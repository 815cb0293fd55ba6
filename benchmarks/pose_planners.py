"""Times the choices of the next touch and of the next view, beside those of the prototypes.

    python -m benchmarks.pose_planners --repeats 10

A touch is chosen among 1000 approaches by the expected fall of the ADI, for 16 poses of a belief;
a view among 100 cameras with 80 x 60 rays each, in cells of 10 mm, after one view. Beside the times
is that of a matrix product, for machines differ, and which part of a choice takes how long.
"""

from collections.abc import Callable
from time import perf_counter
from typing import Annotated

import numpy as np
import typer
from scipy.spatial.transform import Rotation

from benchmarks.matrix_product import NAME, product_time
from crossmodal.diagrams.clutter.scenario import GOODS_DIR
from crossmodal.maths.arrays import Array
from crossmodal.systems.active.occupancy_grid import (
    OccupancyGrid,
    empty_grid,
    expected_gains,
    with_view,
)
from crossmodal.systems.active.touch_planning import (
    TouchConfig,
    candidate_rays,
    expected_adi,
    predict_touches,
)
from crossmodal.systems.active.view_planner import ViewPlannerConfig, hemisphere
from crossmodal.systems.port_values import ObjectPose
from crossmodal.systems.pose.surface import cast_rays
from crossmodal.systems.pose.target_model import TargetModel, load_target

APPROACHES, VIEWS, RAYS, CELL = 1000, 100, (80, 60), 0.01
# Median times of the prototypes, and what is aimed at, [s].
PROTOTYPES = {"touch": 0.020, "view": 0.25}
GOALS = {"touch": 0.025, "view": 0.4}
_SAMPLES, _ERRORS = 256, 27  # Of the belief, and of what may be wrong with the calibration.


def believed(model: TargetModel, rng: np.random.Generator) -> ObjectPose:
    """A Gaussian about an object that stands upright, with some errors of the calibration."""
    sigma = np.repeat([0.03, 5e-3, 1.0], [3, 3, _ERRORS])
    errors = sigma * rng.normal(size=(_SAMPLES, 6 + _ERRORS))
    X = np.eye(4)
    X[:3, 3] = [0.5, 0.0, model.middle[2]]
    samples = np.tile(X, (_SAMPLES, 1, 1))
    samples[:, :3, :3] = Rotation.from_rotvec(errors[:, :3]).as_matrix()
    samples[:, :3, 3] += errors[:, 3:6]
    return ObjectPose(
        X=X,
        covariance=np.diag(sigma[:6] ** 2),
        joint=np.diag(sigma**2),
        samples=samples,
        calibration=errors[:, 6:],
        modes=X[None],
        probabilities=np.ones(1),
        middle=model.middle,
    )


def touch_parts(model: TargetModel, config: TouchConfig) -> dict[str, Callable[[], object]]:
    """The choice among approaches, in parts that follow each other."""
    rng = np.random.default_rng(0)
    belief = believed(model, rng)
    displaced = 1e-3 * rng.normal(size=(6, _ERRORS))
    met = belief.as_met(displaced)

    def rays() -> tuple[Array, Array]:
        # Those that would come too low are kept, so that it is as many as are asked for.
        return candidate_rays(met, model, config, APPROACHES, np.random.default_rng(1))

    starts, directions = rays()
    rng = np.random.default_rng(2)
    predicted = predict_touches(met, model, starts, directions, config, rng)
    return {
        "how the arm meets it": lambda: belief.as_met(displaced),
        "candidates": rays,
        "what they meet": lambda: predict_touches(
            met, model, starts, directions, config, np.random.default_rng(2)
        ),
        "what that is worth": lambda: expected_adi(predicted, model, config.sigma, rng),
    }


def view_parts(model: TargetModel) -> dict[str, Callable[[], object]]:
    """A view that is put into the grid, and the choice of the next one."""
    centre = np.array([0.5, 0.0, model.middle[2]])
    config = ViewPlannerConfig(around=VIEWS // 4, elevations=4, cell=CELL)
    cameras = hemisphere(centre, config)
    side = np.tan(np.deg2rad(config.half_angle))
    u, v = np.meshgrid(*(side * np.linspace(-1.0, 1.0, count) for count in RAYS))
    rays = np.column_stack([u.ravel(), v.ravel(), np.ones(u.size)])
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    grid = empty_grid(centre, model.radius + 0.05, CELL)
    eye, along = cameras[0, :3, 3], np.ascontiguousarray(rays @ cameras[0, :3, :3].T)
    from_eye = np.tile(eye - centre, (len(rays), 1))
    found, _ = cast_rays(from_eye, along, np.full(len(rays), 2.0), model.surface, False)
    met = np.isfinite(found)
    points = eye + found[met, None] * along[met]

    def seen() -> OccupancyGrid:
        return with_view(grid, eye, points, along[~met])

    after = seen()
    return {
        "last view into the grid": seen,
        "what the next ones show": lambda: expected_gains(after, cameras, rays),
    }


def median_times(parts: dict[str, Callable[[], object]], repeats: int) -> dict[str, float]:
    """Median times of the parts, [s]; the first call of each compiles, and is not counted."""
    times: dict[str, list[float]] = {name: [] for name in parts}
    for _ in range(1 + repeats):
        for name, part in parts.items():
            start = perf_counter()
            part()
            times[name].append(perf_counter() - start)
    return {name: float(np.median(some[1:])) for name, some in times.items()}


def main(
    repeats: Annotated[int, typer.Option(min=1, help="Choices that are timed.")] = 10,
    target: Annotated[str, typer.Option(help="One of models/sdf/goods.")] = "spray",
) -> None:
    """Prints the table."""
    model = load_target(GOODS_DIR / target / f"{target}.obj")
    choices = {
        f"touch, {APPROACHES} approaches": touch_parts(model, TouchConfig()),
        f"touch, finger of 13 mm, {APPROACHES} approaches": touch_parts(
            model, TouchConfig(finger=0.013, tilt=45.0)
        ),
        f"view, {VIEWS} cameras of {RAYS[0]} x {RAYS[1]} rays": view_parts(model),
    }
    unit = float(np.median([product_time() for _ in range(repeats)]))
    print(f"A {NAME} takes {1e3 * unit:.1f} ms")
    print("| choice | ms | of a product | / prototype | / goal | parts, ms |")
    print("|---|---|---|---|---|---|")
    for name, parts in choices.items():
        times, kind = median_times(parts, repeats), name.split(",")[0]
        whole = sum(times.values())
        ratios = f"{whole / PROTOTYPES[kind]:.2f} | {whole / GOALS[kind]:.2f}"
        said = ", ".join(f"{part} {1e3 * took:.1f}" for part, took in times.items())
        print(f"| {name} | {1e3 * whole:.1f} | {whole / unit:.1f} | {ratios} | {said} |")


if __name__ == "__main__":
    typer.run(main)
