"""Time that dense clutter at rest takes to simulate, with and without locks.

python -m benchmarks.resting_bodies --objects 8 --seed 1
"""

import time
from typing import Annotated

import numpy as np
import typer
from pydrake.systems.analysis import Simulator

from crossmodal.plants.goods.dense_clutter import ClutterConfig, make_dense_clutter
from crossmodal.plants.goods.goods_scene import GOODS_DIR, GoodsScene
from crossmodal.plants.resting_bodies import RestingBodies

TARGET, MIDDLE = "oil", np.array([0.5, 0.0, 0.0])


def main(
    objects: Annotated[int, typer.Option(min=0, max=11, help="Beside the target.")] = 8,
    seed: Annotated[int, typer.Option(help="Of the scene.")] = 1,
    seconds: Annotated[float, typer.Option(min=0.1, help="That are simulated.")] = 1.0,
) -> None:
    """Prints processor seconds per simulated second, and how far an object has moved."""
    others = sorted(folder.name for folder in GOODS_DIR.iterdir() if folder.is_dir())
    others.remove(TARGET)
    poses = make_dense_clutter(ClutterConfig(count=objects), TARGET, others, MIDDLE, seed)
    spent = {}
    for name in ("free", "locked"):
        scene = GoodsScene(list(poses), MIDDLE)
        scene.place(poses)
        simulator = Simulator(scene.diagram, scene.context)
        if name == "locked":
            bodies = list(scene.bodies.values())
            simulator.set_monitor(RestingBodies(scene.plant, scene.scene_graph, bodies).after_step)
        simulator.Initialize()
        began = time.process_time()
        simulator.AdvanceTo(seconds)
        spent[name] = (time.process_time() - began) / seconds
        moved = max(
            float(np.linalg.norm(X_WO.translation() - poses[one].translation()))
            for one, X_WO in scene.poses().items()
        )
        print(f"{name:7s} {spent[name]:6.2f} s/s, moved by {1e3 * moved:.3f} mm at most")
    print(f"ratio   {spent['free'] / spent['locked']:6.1f}")


if __name__ == "__main__":
    typer.run(main)
