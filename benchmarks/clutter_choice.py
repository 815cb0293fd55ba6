"""Times what leads from an image of dense clutter to the next action.

    OMP_NUM_THREADS=1 python -m benchmarks.clutter_choice --repeats 10

That is on one core if OMP_NUM_THREADS is 1. Beside the times is that of a matrix product, for
machines differ.
"""

from typing import Annotated

import cv2
import numpy as np
import shapely
import typer

from benchmarks.matrix_product import NAME, product_time
from benchmarks.pose_planners import median_times
from crossmodal.diagrams.clutter.training.segmentation_data import render_scene
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
SCENE = 5  # One of dense clutter.
_EVERYWHERE = shapely.box(-1.0, -1.0, 1.0, 1.0)


def rendered_view(seed: int) -> View:
    """An image of 640 x 480 pixels, as the robot's camera takes it."""
    images = render_scene(seed, SCENE, 1)
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


def main(
    repeats: Annotated[int, typer.Option(min=1, help="Choices that are timed.")] = 10,
    seed: Annotated[int, typer.Option(min=0, help="Of the scene.")] = 0,
) -> None:
    """Prints the table."""
    view, segmentation = rendered_view(seed), load_network()
    config, grasping = GraspPlannerConfig(), load_grasp_network(GraspPlannerConfig())
    edges = {name: np.ptp(mesh_vertices(name), axis=0) for name in CLASSES[1:] if name != OTHER}
    lengths = {name: float(np.linalg.norm(own)) for name, own in edges.items()}
    found = objects_in(view, segmentation, lengths, ObjectsConfig())
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
    grasps = find_all_grasps(seen, grasping, config)
    qualities = {number: grasps.best(number) for number in grasps.grasps}
    target = max(segments, key=lambda segment: segment.contour.area).name
    parts = {
        "masks": lambda: objects_in(view, segmentation, lengths, ObjectsConfig()),
        "outlines": lambda: segments_in(view, found, _EVERYWHERE, {}),
        "grasps": lambda: find_all_grasps(seen, grasping, config),
        "graph and push": lambda: declutter_graph(
            scene, target, qualities, NO_TRIES, DeclutterConfig()
        ),
    }
    unit = float(np.median([product_time() for _ in range(repeats)]))
    times = median_times(parts, repeats)
    whole = sum(times.values())
    print(f"{len(segments)} objects; a {NAME} takes {1e3 * unit:.1f} ms")
    print("| from image to action | ms | of a product | / goal |")
    print("|---|---|---|---|")
    for name, took in {**times, "together": whole}.items():
        print(f"| {name} | {1e3 * took:.0f} | {took / unit:.1f} | {took / GOAL:.2f} |")


if __name__ == "__main__":
    typer.run(main)
