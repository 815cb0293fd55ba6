"""The planner of grasps: how each object in an image can be grasped from above."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydrake.systems.framework import Context

from crossmodal.maths.arrays import Array
from crossmodal.maths.validation import check, number
from crossmodal.models import WEIGHTS_DIR
from crossmodal.models.gripper_taxels import PALM_ABOVE
from crossmodal.systems.grasping.grasp_geometry import (
    STROKE,
    highest_between_fingers,
    highest_under_fingers,
    highest_under_palm,
    levers,
    tops,
)
from crossmodal.systems.grasping.grasp_network import grasps_of_output, network_input
from crossmodal.systems.grasping.height_map import (
    CELLS,
    HeightMap,
    height_map,
    seen_points,
)
from crossmodal.systems.onnx_network import OnnxNetwork
from crossmodal.systems.port_values import NO_GRASPS, NO_MASKS, Grasp, Grasps, ObjectMasks
from crossmodal.systems.recursive_filter import RecursiveFilter

_TABLE = 0.012  # Seen heights up to this may be the table's, [m].
_OPENING = 0.005  # Between openings that are tried, [m].
_APART = 0.02  # Grasps that are nearer to each other are alike, [m].


@dataclass(kw_only=True)
class GraspPlannerConfig:
    """What is sought, and what must be free."""

    # File in models/weights, or an absolute path.
    weights: str = "grasp.onnx"
    # Quality of a grasp: of those of less than that a tenth holds.
    least_quality: float = number(0.3, above=0.0, at_most=1.0)
    # Between the fingers and other objects, aside and below: about two standard deviations along an
    # axis of what the arm is believed to be off once it was looked at.
    clearance: float = number(0.005, at_least=0.0, at_most=0.05, unit="m")
    # By which the fingers may be opened wider than the network says: half of it on each side.
    widest: float = number(0.03, at_least=0.0, at_most=0.1, unit="m")
    # By which the fingers reach down beside an object at least; above others they go less deep.
    shallowest: float = number(0.03, above=0.0, at_most=0.1, unit="m")
    # Distance of the fingers from the object's middle at which the quality of a grasp counts
    # exp(-1/2) of what the network says: held beside its middle, an object turns.
    lever: float = number(0.05, above=0.0, at_most=1.0, unit="m")


def load_grasp_network(config: GraspPlannerConfig) -> OnnxNetwork:
    """The network.

    Raises:
        ValueError: where the file is none of its kind.
        FileNotFoundError: where there is no such file.
    """
    return OnnxNetwork(WEIGHTS_DIR / Path(config.weights), (1, CELLS, CELLS))


def plan_grasps(
    view: HeightMap, network: OnnxNetwork, config: GraspPlannerConfig
) -> tuple[Array, Array]:
    """The grasps of an object alone at which the fingers come down on nothing, the best first.

    Args:
        view: Of the object and what is around it.
        network: See `load_grasp_network`.
        config: What must be free.

    Returns:
        Rows (N, 5), see `grasp_geometry`, and their qualities (N,).
    """
    output = network(network_input(view.heights)[None])[0]
    grasps, quality = grasps_of_output(output, view, config.least_quality)
    if not len(grasps):
        return grasps, quality
    # What is held beside its middle turns, and hangs down, or slips.
    quality = quality * np.exp(-0.5 * np.square(levers(view.heights, grasps, view) / config.lever))
    order = np.argsort(-quality, kind="stable")
    order = order[quality[order] >= config.least_quality]
    grasps, quality = grasps[order], quality[order]
    others = np.where(view.others > _TABLE, view.others, 0.0)
    # The network says where and how; whether the fingers are open far enough is seen. Of all free
    # openings the one in the middle is as far from the object as from what is around it.
    openings = np.arange(0.0, config.widest + 1e-9, _OPENING)
    ways = np.repeat(grasps[None], len(openings), axis=0)
    ways[..., 3] = np.minimum(ways[..., 3] + openings[:, None], STROKE)
    flat = ways.reshape(-1, 5)  # A view of them.
    under = highest_under_fingers(others, flat, view, config.clearance)
    above = np.where(under > 0.0, under + config.clearance, 0.0)
    # What is thin is grasped as deep as it is.
    free = tops(view.heights, flat, view) - above >= config.shallowest
    free |= above <= flat[:, 4]
    flat[:, 4] = np.maximum(flat[:, 4], above)
    everything = np.maximum(view.heights, others)
    palm = np.tile(highest_under_palm(everything, grasps, view), len(openings))
    free &= palm <= flat[:, 4] + PALM_ABOVE
    free[free] = highest_between_fingers(others, flat[free], view) <= flat[free, 4]
    free[free] = highest_under_fingers(everything, flat[free], view) <= flat[free, 4]
    free = free.reshape(ways.shape[:2])
    found = np.flatnonzero(free.any(axis=0))
    middle = [k[len(k) // 2] for k in map(np.flatnonzero, free[:, found].T)]
    ways = ways[middle, found]
    unlike = list[int]()
    for k, place in enumerate(ways[:, :2]):
        if (np.linalg.norm(ways[unlike, :2] - place, axis=1) >= _APART).all():
            unlike.append(k)
    return ways[unlike], quality[found][unlike]


def grasp_pose(grasp: Array, table: float) -> Array:
    """X_WE (4, 4) of a grasp (5,): z straight down, x along the opening.

    Args:
        grasp: See `grasp_geometry`.
        table: z of the table in W, [m].
    """
    x, y, angle, _, z = grasp
    c, s = np.cos(angle), np.sin(angle)
    return np.array(
        [[c, s, 0.0, x], [s, -c, 0.0, y], [0.0, 0.0, -1.0, table + z], [0.0, 0.0, 0.0, 1.0]]
    )


def find_all_grasps(masks: ObjectMasks, network: OnnxNetwork, config: GraspPlannerConfig) -> Grasps:
    """The grasps of all objects in an image but glass, through which the camera looks.

    Of 29 grasps of glass on views that the network had not learned from one held.

    Args:
        masks: Of the objects.
        network: See `load_grasp_network`.
        config: What must be free.
    """
    assert masks.intrinsics is not None, "only before the first image there are none"
    glass = np.isin(masks.objects, [*masks.glass])
    depth = np.where(glass, 0.0, masks.depth)  # It is that of what is behind.
    table = masks.table
    seen = seen_points(depth, masks.objects, masks.intrinsics, masks.X_WC, table, masks.glass)
    found = {}
    for label in np.unique(masks.objects[(masks.objects >= 0) & ~glass]).tolist():
        rows, quality = plan_grasps(height_map(seen, label), network, config)
        found[label] = tuple(
            Grasp(X_WE=grasp_pose(row, table), width=float(row[3]), quality=float(q))
            for row, q in zip(rows, quality, strict=True)
        )
    return Grasps(number=masks.number, grasps=found)


class GraspPlanner(RecursiveFilter):
    """Finds how each object can be grasped, whenever there is a new image.

    Grasps are from straight above, as deep as is useful and free. How well one holds is a network's
    to say, from the object's heights alone; what is around it is in the depth image.

    Input ports:
    - `object_masks`: `ObjectMasks`, whose number tells that it is new.

    Output ports:
    - `grasps`: `Grasps` of the last tick, from the state alone; `NO_GRASPS` before the first image.
    """

    def __init__(self, config: GraspPlannerConfig, period: float) -> None:
        """Makes the planner.

        Args:
            config: Of the grasps.
            period: Of the ticks, [s].

        Raises:
            ValueError: for an impossible configuration, and where the file is no such network.
            FileNotFoundError: where there is no such file.
        """
        super().__init__()
        check(config, "GraspPlanner")
        self._config = config
        self._network = load_grasp_network(config)
        self._masks = self._declare_value_input("object_masks", NO_MASKS)
        self._declare_recursion(NO_GRASPS, self._calc, period)
        self._declare_latest("grasps", lambda grasps: grasps)

    def _calc(self, context: Context, grasps: Any) -> Grasps:
        before: Grasps = grasps
        masks: ObjectMasks = self._read(self._masks, context)
        if masks.number == before.number:
            return before
        return find_all_grasps(masks, self._network, self._config)
