"""What views and touches have taught, against what was expected of them when they were chosen."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from crossmodal.diagrams.clutter.scenario import Scenario
from crossmodal.diagrams.run.record import EpisodeRecord, EstimatorRecord
from crossmodal.maths.immutable import Immutable
from crossmodal.systems.active.occupancy_grid import OccupancyGrid, entropy, with_view
from crossmodal.systems.active.touch_planning import expected_squared_distance
from crossmodal.systems.port_values import ObjectPose, PoseMeasurement, ViewRequest
from crossmodal.systems.pose.target_model import TargetModel


@dataclass(frozen=True, kw_only=True)
class Gain(Immutable):
    """Of one view, [bit], or of one touch, [m^2].

    Attributes:
        number: Of the measurement, views and touches together, from one on.
        expected: When it was chosen.
        realised: As the grid or the belief tells afterwards.
        true: Of a touch, the fall of the squared ADI; NaN for a view and without the truth.
    """

    number: int
    expected: float
    realised: float
    true: float = np.nan


def measurements(record: EpisodeRecord) -> list[PoseMeasurement]:
    """Of an episode, in order."""
    found: dict[int, PoseMeasurement] = {}
    for measured in record.station_values("pose_measurement"):
        if measured.kind:
            found.setdefault(measured.number, measured)
    return [found[number] for number in sorted(found)]


def beliefs(estimator: EstimatorRecord) -> dict[int, ObjectPose]:
    """What was believed right after each measurement, by its number; zero is the guess."""
    found: dict[int, ObjectPose] = {}
    for tick in estimator.ticks:
        belief: ObjectPose = tick.values["object_pose_latest"]
        if belief.known:
            found.setdefault(belief.number, belief)
    return found


def outcome(measured: PoseMeasurement) -> int | str:
    """What came of a measurement: the number of a view's points, or how a touch ended."""
    if measured.kind == "view":
        return len(measured.points)
    if len(measured.points):
        return "contact"
    return "miss" if len(measured.free) else "unreachable"


def _requests(record: EpisodeRecord, port: str) -> dict[int, Any]:
    """Requests by their numbers, without those that say that nothing more is wanted."""
    found: dict[int, Any] = {}
    for request in record.station_values(port):
        if request.number > 0 and not getattr(request, "done", False):
            found.setdefault(request.number, request)
    return found


def view_gains(record: EpisodeRecord) -> list[Gain]:
    """By how much each view has lowered the entropy of the occupancy grid, [bit]."""
    scenario: Scenario = record.scenario
    requests = _requests(record, "view_latest")
    if not requests:
        return []
    grid = _empty_grid(requests[min(requests)], scenario.views.cell)
    gains = []
    views = [measured for measured in measurements(record) if measured.kind == "view"]
    for number, measured in enumerate(views, start=1):
        # A view that the arm cannot get to has no camera.
        seen = np.isfinite(measured.eye).all()
        after = with_view(grid, measured.eye, measured.points, measured.passed) if seen else grid
        fall = entropy(grid.log_odds).sum() - entropy(after.log_odds).sum()
        grid = after
        if number in requests:
            gains.append(
                Gain(
                    number=measured.number,
                    expected=requests[number].gain,
                    realised=float(fall),
                )
            )
    return gains


def _empty_grid(first: ViewRequest, cell: float) -> OccupancyGrid:
    """The grid of the planner of views, which fills the box of its first request."""
    shape = np.round(first.box_edges / cell).astype(int)
    corner = first.X_WB[:3, 3] - 0.5 * first.box_edges
    return OccupancyGrid(log_odds=np.zeros(shape), corner=corner, cell=cell)


def touch_gains(
    record: EpisodeRecord, stages: Sequence[Mapping[str, Any]], model: TargetModel
) -> list[Gain]:
    """By how much each touch has lowered the mean squared distance between surfaces, [m^2].

    It is that at the pose as the touching arm meets it, by which touches are chosen. There are none
    of touches that were chosen by another criterion or by lot.

    Args:
        record: Of an episode.
        stages: Of the estimator that touches are chosen by, with `acquisitions` and `as_met`.
        model: Of the object.
    """
    scenario: Scenario = record.scenario
    touches = [measured for measured in measurements(record) if measured.kind == "touch"]
    if not touches or scenario.touches.criterion != "expected-adi":
        return []
    requests = _requests(record, "touch_latest")
    believed = beliefs(record.estimators[scenario.modalities[0]])
    met = {number: belief.as_met(touches[0].displaced) for number, belief in believed.items()}
    distances = {
        number: float(expected_squared_distance(belief.covariance, belief.X, model))
        for number, belief in met.items()
    }
    adi = {stage["acquisitions"]: stage["as_met"]["adi"] for stage in stages}
    gains = []
    for touch, number in enumerate((measured.number for measured in touches), start=1):
        by_lot = touch <= scenario.touches.random_touches
        if by_lot or touch not in requests or not {number - 1, number} <= distances.keys():
            continue
        gains.append(
            Gain(
                number=number,
                expected=requests[touch].gain,
                realised=distances[number - 1] - distances[number],
                true=adi[number - 1] ** 2 - adi[number] ** 2,
            )
        )
    return gains
