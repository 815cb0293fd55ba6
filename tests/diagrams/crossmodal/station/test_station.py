"""The station's sensors on whole scenes."""

from collections.abc import Sequence

import numpy as np
from pydrake.math import RigidTransform

from diagrams.crossmodal.scenario import load_scenario
from diagrams.crossmodal.station.station import Station
from diagrams.run.episode import build_station


def _pixel(station: Station, X_WB: RigidTransform, p_BP: Sequence[float]) -> tuple[int, int]:
    """Row and column at which the camera sees a point of a body."""
    p_CP = station.X_WC.inverse() @ X_WB @ np.array(p_BP)
    u, v, w = station.intrinsics.intrinsic_matrix() @ p_CP
    return round(v / w), round(u / w)


def test_the_glass_pane_is_seen_through_but_returns_no_depth() -> None:
    station = build_station(load_scenario("glass-door"), 3)
    context = station.diagram.CreateDefaultContext()
    station.SetInitialState(context)
    color = station.diagram.GetOutputPort("color_measured").Eval(context).data[:, :, :3]
    depth = station.diagram.GetOutputPort("depth_measured").Eval(context).data[:, :, 0]
    plant = station.scene.plant
    door = plant.GetBodyByName("door").EvalPoseInWorld(plant.GetMyContextFromRoot(context))
    # On the pane and on the stile beside it, in the door's frame.
    for y, returned in ((-0.035, 0.0), (-0.188, 1.0)):
        around = [_pixel(station, door, [0.0, y, z]) for z in np.linspace(-0.15, 0.15, 9)]
        rows, columns = np.array(around).T
        assert np.mean(depth[rows, columns] > 0.0) == returned
        assert color[rows, columns].mean() > 10.0
