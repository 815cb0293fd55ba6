"""Times what leads from an image of dense clutter to the next action.

    OMP_NUM_THREADS=1 python -m benchmarks.clutter_choice

That is on one core if OMP_NUM_THREADS is 1. Beside the times is that of a matrix product, for
machines differ.
"""

from collections.abc import Callable
from typing import Annotated

import cv2
import numpy as np
import shapely
import typer
from tqdm import tqdm

from benchmarks.matrix_product import NAME, product_time
from benchmarks.pose_planners import median_times
from crossmodal.diagrams.clutter.training.segmentation_data import render_scene
from crossmodal.maths.arrays import Array
from crossmodal.maths.pinhole import Intrinsics
from crossmodal.plants.goods.dense_clutter import mesh_vertices
from crossmodal.systems.declutter.declutter_graph import DeclutterConfig, declutter_graph
from crossmodal.systems.grasping.grasp_planner import (
    GraspPlannerConfig,
    find_all_grasps,
    load_grasp_network,
)
from crossmodal.systems.port_values import NO_TRIES, ObjectMasks, Segments
from crossmodal.systems.segmentation.network_input import CLASSES, OTHER
from crossmodal.systems.segmentation.objects import ObjectsConfig, load_network
from crossmodal.systems.segmentation.segmenter import View, objects_in, segments_in

GOAL = 0.3  # [s].
_LEAST = 6  # Objects that are seen in a scene that counts.
_EVERYWHERE = shapely.box(-1.0, -1.0, 1.0, 1.0)


def rendered_view(seed: int, scene: int) -> View:
    """An image of 640 x 480 pixels, as the robot's camera takes it."""
    images = render_scene(seed, scene, 1)
    small = images.intrinsics(0)
    intrinsics = Intrinsics(
        width=640,
        height=480,
        focal_x=2.0 * small.focal_x,
        focal_y=2.0 * small.focal_y,
        center_x=2.0 * small.center_x + 0.5,
        center_y=2.0 * small.center_y + 0.5,
    )
    depth = images.depth[0].astype(float)
    return View(
        colour=cv2.resize(images.colour[0], (640, 480), interpolation=cv2.INTER_LINEAR),
        depth=cv2.resize(depth, (640, 480), interpolation=cv2.INTER_NEAREST),
        masked=np.zeros((480, 640), bool),
        intrinsics=intrinsics,
        X_WC=images.X_WC[0],
        table=0.0,
    )


class Choice:
    """What leads from an image to the next action.

    Args:
        edges: Of the boxes around goods (3,), by their names, [m].
    """

    def __init__(self, edges: dict[str, Array]) -> None:
        self._segmentation, self._config = load_network(), GraspPlannerConfig()
        self._grasping = load_grasp_network(self._config)
        self._lengths = {name: float(np.linalg.norm(own)) for name, own in edges.items()}

    def parts(self, view: View) -> tuple[int, dict[str, Callable[[], object]]]:
        """How many objects are seen, and the parts of the choice by name."""
        found = objects_in(view, self._segmentation, self._lengths, ObjectsConfig())
        segments, masks = segments_in(view, found, _EVERYWHERE, {})
        objects = np.full(view.depth.shape, -1)
        for segment, mask in zip(segments, masks, strict=True):
            objects[mask] = segment.number
        seen = ObjectMasks(
            number=1,
            view=1,
            objects=objects,
            colour=view.colour,
            depth=view.depth,
            intrinsics=view.intrinsics,
            X_WC=view.X_WC,
        )
        scene = Segments(number=1, time=0.0, segments=segments)
        grasps = find_all_grasps(seen, self._grasping, self._config)
        qualities = {number: grasps.best(number) for number in grasps.grasps}
        middle = np.mean([segment.centroid for segment in segments] or [np.zeros(2)], axis=0)
        target = min(
            (segment for segment in segments if segment.name),
            key=lambda segment: float(np.linalg.norm(segment.centroid - middle)),
            default=None,
        )
        name = "" if target is None else target.name
        return len(segments), {
            "masks": lambda: objects_in(view, self._segmentation, self._lengths, ObjectsConfig()),
            "outlines": lambda: segments_in(view, found, _EVERYWHERE, {}),
            "grasps": lambda: find_all_grasps(seen, self._grasping, self._config),
            "graph and push": lambda: declutter_graph(
                scene, name, qualities, NO_TRIES, DeclutterConfig()
            ),
        }


def main(
    repeats: Annotated[int, typer.Option(min=1, help="Choices that are timed.")] = 3,
    scenes: Annotated[int, typer.Option(min=1, help="Of dense clutter, seen from one place.")] = 12,
    seed: Annotated[int, typer.Option(min=0, help="Of the scenes.")] = 0,
) -> None:
    """Prints the table."""
    edges = {name: np.ptp(mesh_vertices(name), axis=0) for name in CLASSES[1:] if name != OTHER}
    choice, times, number = Choice(edges), list[dict[str, float]](), 0
    with tqdm(total=scenes, disable=None) as progress:
        while len(times) < scenes:
            objects, parts = choice.parts(rendered_view(seed, number))
            number += 1
            if objects >= _LEAST:
                times.append(median_times(parts, repeats))
                progress.update()
    unit = float(np.median([product_time() for _ in range(10)]))
    print(f"{scenes} scenes of {_LEAST} and more objects; a {NAME} takes {1e3 * unit:.1f} ms")
    print("| from image to action | median, ms | of a product | / goal | slowest, ms |")
    print("|---|---|---|---|---|")
    took = {name: np.array([each[name] for each in times]) for name in times[0]}
    for name, each in {**took, "together": np.sum(list(took.values()), axis=0)}.items():
        median, slowest = np.median(each), each.max()
        print(
            f"| {name} | {1e3 * median:.0f} | {median / unit:.1f} | {median / GOAL:.2f}"
            f" | {1e3 * slowest:.0f} |"
        )


if __name__ == "__main__":
    typer.run(main)
