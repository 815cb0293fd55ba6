"""What stands on a table around a target, and in which order to take it away, by which action.

Frame: places are x and y in the world W, whose z points up, in metres. What a camera sees is moved
to the table's plane (`declutter.segments`): there a distance, a box and the width of a finger mean
the same from wherever a camera looks and however many pixels it has, and pushes are planned there.
In pixels, as in the paper, thresholds would hold for one camera at one place. Shapes are Shapely's,
which cannot be written.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum

import numpy as np
import numpy.typing as npt
import shapely

from crossmodal.maths.arrays import Array, Ids, unknown
from crossmodal.maths.immutable import Immutable
from crossmodal.maths.pinhole import Intrinsics
from crossmodal.systems.port_values.pose import Bodies

_NOTHING: shapely.Geometry = shapely.Polygon()
_NOWHERE: shapely.Geometry = shapely.MultiPoint()


class DeclutterAction(StrEnum):
    """How an object is taken out of the way."""

    GRASP = "grasp"
    PUSH = "push"


@dataclass(frozen=True, kw_only=True)
class Segment(Immutable):
    """An object as one image of the scene shows it.

    Attributes:
        number: Of the object, zero or above; the same from image to image.
        name: Of its class; empty for an object of no known class.
        contour: The polygon around it, in W, [m]; in several parts where an image says so. Of an
            object that is wider above than at its foot, it is that of the widest place.
        pixels: The same in the image, [px]; empty where there is none.
        top: Height of the object above the table, [m]; NaN where it is not known.
        is_glass: Whether a depth camera looks through it; the top is the greatest possible, then.
        base: Height of what most of it is above, [m]; zero where that is not seen.
        least_top: Least possible height of glass, [m]; NaN of other things.
        covered: Share of its outline in the image along which another object is before it, 0 to 1.
        is_cut: Whether the image's border cuts it off; all of it where it has no pixels, then it is
            where it was when it was seen last.

    Raises:
        ValueError: for a contour without an area and for one that crosses itself.
    """

    number: int
    name: str = ""
    contour: shapely.Geometry
    pixels: shapely.Geometry = _NOTHING
    top: float = np.nan
    is_glass: bool = False
    base: float = 0.0
    least_top: float = np.nan
    covered: float = 0.0
    is_cut: bool = False

    def __post_init__(self) -> None:
        if not (self.contour.is_valid and self.contour.area > 0.0):
            why = shapely.is_valid_reason(self.contour)
            raise ValueError(f"object {self.number}: the contour must have an area: {why}")

    @property
    def box(self) -> shapely.Polygon:
        """The rectangle of least area around the contour, in W, [m]."""
        return self.contour.oriented_envelope

    @property
    def centroid(self) -> Array:
        """Of the contour's area (2,), in W, [m]."""
        return shapely.get_coordinates(self.contour.centroid)[0]


@dataclass(frozen=True, kw_only=True)
class Segments(Immutable):
    """All objects that one image shows.

    Attributes:
        number: Of the image, from one on; zero: there is none yet.
        time: When it was taken, [s].
        segments: In any order, each with a number of its own.
        table: z at which the table is seen, in W as the camera has it, [m].
        bare: Where the image shows the table itself.
    """

    number: int = 0
    time: float = 0.0
    table: float = 0.0
    bare: shapely.Geometry = field(default_factory=shapely.Polygon)
    segments: tuple[Segment, ...] = ()

    def largest(self, name: str, near: shapely.Geometry | None = None) -> Segment | None:
        """The object of a class that covers most of the table; among equals the lowest number.

        Args:
            name: Of the class.
            near: Part of the table that it is to touch; None for all of it.
        """
        named = [segment for segment in self.segments if segment.name == name]
        if near is not None:
            named = [segment for segment in named if segment.contour.intersects(near)]
        return min(named, key=lambda s: (-round(s.contour.area, 9), s.number), default=None)


@dataclass(frozen=True, kw_only=True)
class Grasp(Immutable):
    """A grasp by two fingers that approach along z of E, today always from above.

    Attributes:
        X_WE: Of the gripper's frame E (4, 4) when it has closed: the middle of the fingers' ends, z
            along the approach, x along the opening.
        width: Between the fingers' faces before they close, [m].
        quality: 0 to 1, the network's, by which grasps are compared; no probability.
    """

    X_WE: Array
    width: float
    quality: float


@dataclass(frozen=True, kw_only=True)
class Grasps(Immutable):
    """The grasps of each object.

    Attributes:
        number: Of the image that they were found in.
        grasps: By the objects' numbers, the best first and each at a place of its own; an object
            without one cannot be grasped.
    """

    number: int = 0
    grasps: Mapping[int, tuple[Grasp, ...]] = field(default_factory=dict)

    def best(self, number: int) -> float:
        """Quality of the best grasp of an object; zero for none."""
        return max((grasp.quality for grasp in self.grasps.get(number, ())), default=0.0)


@dataclass(frozen=True, kw_only=True)
class Tries(Immutable):
    """How often each action has failed on each object, and how often it was moved.

    Attributes:
        number: Of the image up to which they were counted.
        moved: How often an object was moved by an action on it, by its number.
        failed: Counts by the object's number and the action.
        hindered: Likewise of those that something in the way prevented, since something near the
            object was moved: that may have been it.
        unreachable: Which the arm could not even begin since then: it could not do so again.
        blocked: Places in W at which a finger came down on something that rests there still.
    """

    number: int = 0
    moved: Mapping[int, int] = field(default_factory=dict)
    failed: Mapping[tuple[int, DeclutterAction], int] = field(default_factory=dict)
    hindered: Mapping[tuple[int, DeclutterAction], int] = field(default_factory=dict)
    unreachable: frozenset[tuple[int, DeclutterAction]] = frozenset()
    blocked: shapely.Geometry = _NOWHERE

    def may(self, number: int, action: DeclutterAction, tries: int) -> bool:
        """Whether an action may be tried on an object, of which so many tries are allowed."""
        return (number, action) not in self.unreachable and self.count(number, action) < tries

    def count(self, number: int, action: DeclutterAction) -> int:
        """How often an action has failed on an object."""
        key = (number, action)
        return self.failed.get(key, 0) + self.hindered.get(key, 0)

    def with_failure(self, number: int, action: DeclutterAction, hindered: bool) -> "Tries":
        """The same and one more."""
        key, counts = (number, action), self.hindered if hindered else self.failed
        counts = {**counts, key: counts.get(key, 0) + 1}
        return replace(self, hindered=counts) if hindered else replace(self, failed=counts)

    def with_motion(self, number: int) -> "Tries":
        """After an action that has moved its object."""
        return replace(self, moved={**self.moved, number: self.moved.get(number, 0) + 1})

    def out_of_reach(self, number: int, action: DeclutterAction) -> "Tries":
        """After one that the arm could not even begin."""
        return replace(self, unreachable=self.unreachable | {(number, action)})

    def blocked_at(self, places: Array) -> "Tries":
        """After fingers came down on something at these places (K, 2), in W, [m]."""
        return replace(self, blocked=self.blocked.union(shapely.MultiPoint(places)))

    def after_motion(self, near: Collection[int], gone: shapely.Geometry) -> "Tries":
        """After something was moved, which may have been in the way.

        Args:
            near: Numbers of the objects near which it was.
            gone: Where it was, in W.
        """
        return replace(
            self,
            blocked=self.blocked.difference(gone),
            hindered={key: count for key, count in self.hindered.items() if key[0] not in near},
            unreachable=frozenset(key for key in self.unreachable if key[0] not in near),
        )


@dataclass(frozen=True, kw_only=True)
class Push(Immutable):
    """A straight push of an object over the table by a finger that is already behind it.

    Attributes:
        why: Why there is none, in words; empty if there is one. Without one all else is NaN or
            empty.
        point: Where the finger pushes on the contour (2,), in W, [m].
        direction: Of the push (2,), a unit vector in W.
        length: From the contact on, [m].
        reach: Way of the finger to beside the object's middle, [m]; what it has not met by then is
            not where it seems to be.
        height: Of the fingers' ends above the table, [m].
        place: Where the middle of the fingers comes down (2,), in W, [m].
        opening: Of each finger, [m].
        finger: The rectangle in which the finger comes down that pushes, in W, [m].
        meets: Numbers of the others that finger or object meet on the way, and take along.
        topples: Whether the object may fall over, ahead.
        lever: By which it passes the object's middle on the left and turns it, [m].
    """

    why: str = ""
    point: Array = unknown(2)
    direction: Array = unknown(2)
    length: float = np.nan
    reach: float = np.nan
    height: float = np.nan
    place: Array = unknown(2)
    opening: float = 0.0
    finger: shapely.Geometry = _NOTHING
    meets: tuple[int, ...] = ()
    topples: bool = False
    lever: float = 0.0

    @property
    def is_sure(self) -> bool:
        """Whether it moves the object alone, without turning it over or around."""
        return not (self.meets or self.topples or self.lever)


@dataclass(frozen=True, kw_only=True)
class DeclutterVertex(Immutable):
    """An object in the tree, and the edge that leads to it.

    Attributes:
        segment: The object.
        parent: Number of the object that it hangs on; -1 for the root, which is the target.
        weight: Of the edge from there, above 0 to 2; zero for the root.
        quality: Of its best grasp, 0 to 1; zero where there is none, and for the root.
        action: By which to take it away; None for the root, and where none is possible.
        why: Why none is possible, in words.
    """

    segment: Segment
    parent: int = -1
    weight: float = 0.0
    quality: float = 0.0
    action: DeclutterAction | None = None
    why: str = ""


@dataclass(frozen=True, kw_only=True)
class DeclutterGraph(Immutable):
    """A tree of objects with the target as its root, and what to do next.

    Attributes:
        number: Of the image that it was made from; zero: there is none yet.
        vertices: The root, then what hangs on it, then what hangs on that, and so on.
        apart: The objects that hang on nothing.
        is_guess: Whether no image has shown the target yet, so that the root is only where it may
            be.
        next: Number of the object to take away; -1 for none.
        is_covered: Whether others are before much of that, so that it is to be seen from elsewhere.
        pushes: How it may be pushed, where it is to be, the best one first.
        why: Why there is none, in words.
    """

    number: int = 0
    vertices: tuple[DeclutterVertex, ...] = ()
    apart: tuple[Segment, ...] = ()
    is_guess: bool = False
    next: int = -1
    is_covered: bool = False
    pushes: tuple[Push, ...] = ()
    why: str = ""

    def vertex(self, number: int) -> DeclutterVertex:
        """The vertex of an object.

        Raises:
            KeyError: with the numbers that there are, where it is not in the tree.
        """
        vertices = {vertex.segment.number: vertex for vertex in self.vertices}
        if number not in vertices:
            raise KeyError(f"object {number} is not in the tree; there are {[*vertices]}")
        return vertices[number]

    def leaves(self, staying: Collection[int] = ()) -> tuple[DeclutterVertex, ...]:
        """On which nothing hangs, without the root, and as if some objects were not there."""
        rest = [v for v in self.vertices if v.segment.number not in staying]
        parents = {vertex.parent for vertex in rest}
        return tuple(v for v in rest if v.parent >= 0 and v.segment.number not in parents)


@dataclass(frozen=True, kw_only=True)
class ActionRequest(Immutable):
    """What an arm is to do with an object on the table.

    Attributes:
        number: Of the request, from one on; zero: nothing is wanted.
        action: How the object is taken away.
        object: Its number.
        grasps: That may be tried, the preferred one first: the first that the arm can reach is
            made; empty for a push.
        pushes: Likewise; empty for a grasp.
        places: Where a grasped object may be put down (K, 2), x and y in W of the frame E, the
            preferred one first, [m].
        passed: Of each place, how high that is which the object passes over on a straight way
            there (K,), above the table, [m].
        top: Height of the object above the table, [m]; NaN where it is not known.
        landing: Of a way down, what stops the fingers so near to its end is the table, [m].
        obstacles: Vertices (N, 3) in W of convex bodies that hold all other objects, [m]; the arm
            goes through none of them, and the gripper neither on its way to the object.
        done: Whether no more requests follow, so that the arm goes home.
    """

    number: int = 0
    action: DeclutterAction = DeclutterAction.PUSH
    object: int = -1
    grasps: tuple[Grasp, ...] = ()
    pushes: tuple[Push, ...] = ()
    places: Array = field(default_factory=lambda: np.zeros((0, 2)))
    passed: Array = field(default_factory=lambda: np.zeros(0))
    top: float = np.nan
    landing: float = 5e-3
    obstacles: Bodies = ()
    done: bool = False


@dataclass(frozen=True, kw_only=True)
class ArmOffset(Immutable):
    """By how much an arm meets objects beside where a camera sees them, in W.

    What the camera sees at p the arm meets at p + mean, with this covariance.

    Attributes:
        mean: (3,), [m].
        covariance: (3, 3), [m^2].
        view: Number of the view of the arm that is counted in; zero before.
    """

    mean: Array = field(default_factory=lambda: np.zeros(3))
    covariance: Array = field(default_factory=lambda: np.zeros((3, 3)))
    view: int = 0


@dataclass(frozen=True, kw_only=True)
class DeclutterStep(Immutable):
    """What came of an action, by the images before and after it.

    Attributes:
        image: Number of the image by which it was chosen.
        object: Number of the object.
        name: Of its class; empty for none.
        action: By which it was to be taken away.
        outcome: What the arm says of it.
        displacement: How far it has gone at least, [m]; infinite if it is not seen any more.
        worked: Whether it was moved.
        others: Numbers of the others that were moved, too.
    """

    image: int
    object: int
    name: str
    action: DeclutterAction
    outcome: str
    displacement: float
    worked: bool
    others: tuple[int, ...] = ()


@dataclass(frozen=True, kw_only=True)
class DeclutterProgress(Immutable):
    """What was done to free the target.

    Attributes:
        steps: All actions that were judged.
        done: Whether no more follow.
        found: Whether the target was seen in the last image.
        why: Why it ended, in words; empty if the target is free.
    """

    steps: tuple[DeclutterStep, ...] = ()
    done: bool = False
    found: bool = False
    why: str = ""


@dataclass(frozen=True, kw_only=True)
class ObjectMasks(Immutable):
    """Which pixels of an image show which object.

    Attributes:
        number: Of the image, as in `Segments`.
        view: Number of the view at which it was taken.
        objects: Number of the object that each pixel shows (H, W); -1 where none.
        glass: Numbers of those that a depth camera looks through, and how high each is at most
            above the table, [m].
        colour: Red, green and blue (H, W, 3), 0 to 255.
        depth: (H, W) along the camera's axis, [m]; zero where none was measured.
        intrinsics: Of the image; None before the first one.
        X_WC: Of the camera (4, 4), where it is believed to have been.
        table: As in `Segments`.
    """

    number: int = 0
    view: int = 0
    table: float = 0.0
    objects: Ids = field(default_factory=lambda: np.full((0, 0), -1))
    glass: Mapping[int, float] = field(default_factory=dict)
    colour: npt.NDArray[np.uint8] = field(default_factory=lambda: np.zeros((0, 0, 3), np.uint8))
    depth: Array = field(default_factory=lambda: np.zeros((0, 0)))
    intrinsics: Intrinsics | None = None
    X_WC: Array = unknown(4, 4)


NO_SEGMENTS = Segments()
NO_GRASPS = Grasps()
NO_TRIES = Tries()
NO_GRAPH = DeclutterGraph(why="there is no image yet")
NO_ACTION = ActionRequest()
NO_MASKS = ObjectMasks()
NO_PROGRESS = DeclutterProgress()
NO_OFFSET = ArmOffset()
