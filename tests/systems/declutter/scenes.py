"""Objects on a table as rectangles, and scenes of them by lot."""

import numpy as np
import shapely

from crossmodal.maths.arrays import Array
from crossmodal.systems.declutter.push import (
    PushConfig,
    finger_places,
    outlines_on_the_way,
    rectangles,
    spared,
)
from crossmodal.systems.port_values import Segment, Segments

EVERYWHERE = shapely.box(-2.0, -2.0, 2.0, 2.0)
NAMES = ("wineglass", "can", "sponge", "marker", "", "box")


def rectangle(
    number: int,
    name: str,
    place: tuple[float, float],
    size: tuple[float, float] = (0.04, 0.04),
    angle: float = 0.0,
) -> Segment:
    """Of these edges [m] around a place, turned by an angle [rad], and 5 cm high."""
    corners = 0.5 * np.array(size) * [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]
    contour = shapely.Polygon(corners @ rotation(angle).T + place)
    return Segment(number=number, name=name, contour=contour, top=0.05)


def rotation(angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


def random_scene(seed: int, count: int = 10, spread: float = 0.1) -> tuple[Segment, ...]:
    """So many rectangles; the first one is the only wineglass."""
    rng = np.random.default_rng(seed)
    found = []
    for number in range(count):
        x, y = rng.normal(scale=spread, size=2)
        width, height = rng.uniform(0.02, 0.12, 2)
        name = NAMES[0] if number == 0 else NAMES[1 + number % 5]
        turn = rng.uniform(0.0, np.pi)
        found.append(rectangle(number, name, (0.5 + x, y), (width, height), turn))
    return tuple(found)


def image(*segments: Segment, number: int = 1, shown: shapely.Geometry = EVERYWHERE) -> Segments:
    """What an image shows that is taken from straight above."""
    bare = shapely.difference(shown, shapely.union_all([s.contour for s in segments]))
    return Segments(number=number, time=0.1 * number, segments=segments, bare=bare)


def finger_place(
    segment: Segment, direction: Array, offset: float, config: PushConfig
) -> tuple[Array, shapely.Polygon] | None:
    """A single one: its point and rectangle."""
    points, edges = finger_places(segment, direction, np.array([offset]), config)
    return (points[0], rectangles(segment, direction, edges)[0]) if len(points) else None


def spares(segment: Segment, target: Segment, motion: Array, clearance: float) -> bool:
    """Whether an object that moves straight leaves the target alone."""
    length = float(np.linalg.norm(motion))
    lengths = np.linspace(0.0, length, 51)
    return bool(
        spared(outlines_on_the_way(segment, motion / length, 0.0, lengths), target, clearance).all()
    )


def along(polygon: Array, count: int = 400) -> Array:
    """Points on the edges of a polygon, so many on each."""
    share = np.linspace(0.0, 1.0, count)[:, None, None]
    return np.asarray(((1 - share) * polygon + share * np.roll(polygon, -1, axis=0)).reshape(-1, 2))
