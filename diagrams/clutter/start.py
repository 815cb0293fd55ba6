"""How an episode begins: where the object truly is, and what is known of that."""

import numpy as np
from pydrake.math import RigidTransform
from scipy.spatial.transform import Rotation
from tqdm import tqdm

from crossmodal.diagrams.clutter.robot_config import TOUCH_ARM
from crossmodal.diagrams.clutter.scenario import Scenario, generator, other_goods, target_name
from crossmodal.diagrams.run.calibration import Calibration, draw_base, draw_camera
from crossmodal.maths.arrays import Array
from crossmodal.plants.goods.dense_clutter import make_dense_clutter
from crossmodal.systems.port_values import PosePrior, of_mesh
from crossmodal.systems.pose.target_model import TargetModel


def _range(rng: np.random.Generator, ends: Array) -> float:
    return float(rng.uniform(ends[0], ends[1]))


def _direction(rng: np.random.Generator) -> Array:
    n = rng.normal(size=3)
    return np.asarray(n / np.linalg.norm(n))


def true_pose(scenario: Scenario, model: TargetModel) -> Array:
    """X_WM (4, 4) of a seed: on the table, turned about the vertical; or held up in any way."""
    rng = generator(scenario, "object")
    X = np.eye(4)
    X[:3, :3] = Rotation.from_rotvec([0.0, 0.0, rng.uniform(-np.pi, np.pi)]).as_matrix()
    if not scenario.table.known:
        X[:3, :3] = Rotation.from_quat(rng.normal(size=4)).as_matrix()
    X[:2, 3] = _place(rng)
    X[2, 3] = -float(np.min(model.hull @ X[2, :3]))
    return X


def _place(rng: np.random.Generator) -> list[float]:
    """Where the object is in W's x and y, [m]."""
    return [rng.uniform(0.4, 0.6), rng.uniform(-0.1, 0.1)]


def clutter_poses(scenario: Scenario) -> dict[str, RigidTransform]:
    """X_WO of all objects of a seed by their names, the sought one first; none without clutter.

    It takes up to a minute until all have come to rest; where a person waits, that is shown.
    """
    if scenario.clutter.count == 0:
        return {}
    p_WMiddle = np.array([*_place(generator(scenario, "clutter")), 0.0])
    target, others = target_name(scenario), other_goods(scenario)
    what = f"{scenario.clutter.count + 1} objects come to rest, which may take a minute"
    with tqdm(desc=what, bar_format="{desc}", disable=None, leave=False):
        return make_dense_clutter(scenario.clutter, target, others, p_WMiddle, scenario.seed)


def true_displacement(scenario: Scenario, calibration: Calibration) -> Array:
    """By which pose (4, 4) in W the touching arm is displaced, by where its base truly stands.

    It is at X p where it is believed to be at p. A rig's arm is believed to stand in W.
    """
    name, X_WBase = "arm", RigidTransform()
    if scenario.station == "robots":
        name, X_WBase = TOUCH_ARM, calibration.arms[TOUCH_ARM].X_WBase
    true = draw_base(name, X_WBase, scenario.calibration.drawn_errors(scenario.seed), scenario.seed)
    return np.asarray((true @ X_WBase.inverse()).GetAsMatrix4())


def true_offset(scenario: Scenario, calibration: Calibration, X_WC: Array, p: Array) -> Array:
    """By how much the touching arm meets a place beside where the camera sees it (3,), in W, [m].

    Args:
        scenario: With the seed and the errors.
        calibration: As believed.
        X_WC: Of the camera as believed (4, 4).
        p: Where it sees the place (3,), [m].
    """
    ((name, believed),) = calibration.cameras.items()
    camera = draw_camera(
        name, believed, scenario.calibration.drawn_errors(scenario.seed), scenario.seed
    )
    mounting = (believed.X_PC.inverse() @ camera.X_PC).GetAsMatrix4()
    p_C = np.linalg.inv(X_WC) @ np.append(p, 1.0)
    p_C[:3] *= believed.depth_scale / camera.depth_scale
    p_C[0] *= believed.intrinsics.focal_x / camera.intrinsics.focal_x
    p_C[1] *= believed.intrinsics.focal_y / camera.intrinsics.focal_y
    p_WTrue = X_WC @ mounting @ p_C
    X_met = np.linalg.inv(true_displacement(scenario, calibration))
    return np.asarray((X_met @ p_WTrue)[:3] - p)


def first_guess(scenario: Scenario, X_WM: Array, model: TargetModel) -> PosePrior:
    """What is known at first: the pose, with an error between the scenario's ends."""
    rng, guess = generator(scenario, "guess"), scenario.guess
    turn = np.deg2rad(_range(rng, guess.rotation)) * _direction(rng)
    move = _range(rng, guess.translation) * _direction(rng)
    X = X_WM.copy()
    X[:3, :3] = X_WM[:3, :3] @ Rotation.from_rotvec(turn).as_matrix()
    X[:3, 3] += move
    return PosePrior(
        X=of_mesh(X, model.middle),
        rotation_sigma=float(np.deg2rad(guess.rotation.mean()) / np.sqrt(3.0)),
        translation_sigma=float(guess.translation.mean() / np.sqrt(3.0)),
    )
