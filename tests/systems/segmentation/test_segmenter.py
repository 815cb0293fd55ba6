from typing import Any

import numpy as np
import pytest
import shapely
from numpy.testing import assert_allclose, assert_array_equal
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context
from pydrake.systems.sensors import ImageDepth32F, ImageGrey8U, ImageRgba8U

from crossmodal.maths.pinhole import Intrinsics
from crossmodal.systems.port_values import ObjectMasks, Segment, Segments, StampedImage
from crossmodal.systems.segmentation.network_input import CLASSES
from crossmodal.systems.segmentation.segmenter import (
    Segmenter,
    SegmenterConfig,
    greatest_height,
    top_of_glass,
)
from tests.documented_ports import documented_ports

CAMERA = Intrinsics(
    width=320, height=240, focal_x=288.0, focal_y=288.0, center_x=159.5, center_y=119.5
)
# It looks straight down at the table from .6 m; the image's right is the world's x.
X_WC = np.array(
    [[1.0, 0.0, 0.0, 0.5], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, -1.0, 1.3], [0.0, 0.0, 0.0, 1.0]]
)
TABLE = 0.7
REGION = shapely.box(0.3, -0.2, 0.7, 0.2)
RED = np.array([255, 0, 0], np.uint8)


class Red:
    """A network that takes red for things of a class."""

    def __init__(self, name: str) -> None:
        self.index = CLASSES.index(name)

    def __call__(self, x: np.ndarray) -> np.ndarray:
        logits = np.zeros((1, len(CLASSES), 120, 160), np.float32)
        logits[0, 0] = 5.0
        logits[0, self.index] = 10.0 * (x[0, 0] > x[0, 1] + 0.5)[::2, ::2]
        return logits


class Rig:
    """A segmenter and what it is given."""

    def __init__(self, name: str = "can", skipped: int = 0) -> None:
        network: Any = Red(name)
        edges = {name: np.array([0.08, 0.08, 0.2])}
        config = SegmenterConfig()
        self.system = Segmenter(network, CAMERA, TABLE, REGION, edges, config, 0.1, skipped)
        self.context: Context = self.system.CreateDefaultContext()

    def look(
        self,
        number: int,
        cans: list[tuple[int, int]],
        robot: bool = False,
        time: float = 1.0,
        height: float = 0.07,
        aside: float = 0.0,
    ) -> Segments:
        """Shows cans with a square top at rows and columns, 7 cm high; returns what is said."""
        colour = ImageRgba8U(320, 240)
        colour.mutable_data[:] = 255
        depth, mask = ImageDepth32F(320, 240), ImageGrey8U(320, 240)
        depth.mutable_data[:] = 0.6
        mask.mutable_data[:] = 0
        for v, u in cans:
            colour.mutable_data[v : v + 30, u : u + 30, :3] = RED
            depth.mutable_data[v : v + 30, u : u + 30] = 0.6 - height
        if robot:
            mask.mutable_data[:] = 1
        for port, image in (("color_measured", colour), ("depth_measured", depth)):
            X_moved = X_WC.copy()
            X_moved[0, 3] += aside
            stamped = StampedImage(time=time, image=image, X_WC=X_moved)
            self.system.GetInputPort(port).FixValue(self.context, AbstractValue.Make(stamped))
        self.system.GetInputPort("robot_mask").FixValue(self.context, AbstractValue.Make(mask))
        self.system.GetInputPort("looked").FixValue(self.context, [float(number)])
        self.system.ExecuteForcedEvents(self.context)
        return self.system.GetOutputPort("segments").Eval(self.context)

    def masks(self) -> ObjectMasks:
        return self.system.GetOutputPort("object_masks").Eval(self.context)


@pytest.fixture
def rig() -> Rig:
    return Rig()


def test_before_the_first_view_there_is_no_image(rig: Rig) -> None:
    assert rig.look(0, [(60, 60)]) == Segments()
    assert rig.masks().number == 0


def test_views_of_something_else_are_left_out() -> None:
    rig = Rig(skipped=1)
    assert rig.look(1, [(60, 60)]) == Segments()
    assert rig.look(2, [(60, 60)]).number == 1


def test_an_object_is_where_its_rays_meet_its_height(rig: Rig) -> None:
    seen = rig.look(1, [(104, 144)])
    assert (seen.number, seen.time) == (1, 1.0)
    (can,) = seen.segments
    assert can.name == "can"
    # Its square of 30 pixels is a pixel up and left of the image's middle, at a depth of .53 m.
    assert_allclose(can.centroid, [0.5 - 0.53 / 288, 0.53 / 288], atol=1e-3)
    assert_allclose(can.contour.area, (30 * 0.53 / 288) ** 2, rtol=0.05)
    assert_allclose(can.top, 0.07, atol=1e-6)


@pytest.mark.parametrize("beneath", [0.0, 0.07])
def test_glass_is_as_high_as_it_can_be_on_what_is_seen_through_it(beneath: float) -> None:
    rig = Rig("wineglass")
    (glass,) = rig.look(1, [(104, 144)], height=beneath).segments
    assert glass.top == pytest.approx(beneath + np.hypot(0.08, 0.2), abs=1e-6)
    assert [glass.base, glass.least_top] == pytest.approx([beneath, beneath + 0.08], abs=1e-6)
    # It is outlined as if it lay, its middle .04 m above that.
    away = 0.56 - beneath
    assert_allclose(glass.centroid, [0.5 - away / 288, away / 288], atol=1e-3)
    assert_allclose(glass.contour.area, (30 * away / 288) ** 2, rtol=0.05)
    assert rig.masks().glass == {0: glass.top}


@pytest.mark.parametrize(
    ("length", "top"),
    [
        (0.05, np.hypot(0.08, 0.2)),
        (0.12, np.hypot(0.08, 0.2)),
        (0.19, 0.08 + np.sqrt(0.2**2 - 0.19**2)),
        (0.21, 0.08),
    ],
)
def test_glass_that_lies_is_not_as_high_as_it_is_long(length: float, top: float) -> None:
    contour = shapely.box(0.0, 0.0, length, 0.08)
    found = greatest_height(Segment(number=0, contour=contour), np.array([0.08, 0.2, 0.08]))
    assert found == pytest.approx(top)


def test_glass_lies_on_the_highest_or_stands_on_the_most_of_what_is_beneath() -> None:
    edges = np.array([0.08, 0.2, 0.08])
    lying = Segment(number=0, contour=shapely.box(0.0, 0.0, 0.21, 0.08))
    assert top_of_glass(lying, edges, 0.0, 0.0) == pytest.approx(0.08)
    assert top_of_glass(lying, edges, 0.0, 0.15) == pytest.approx(0.23)
    standing = Segment(number=0, contour=shapely.box(0.0, 0.0, 0.08, 0.08))
    height = greatest_height(standing, edges)
    assert top_of_glass(standing, edges, 0.02, 0.05) == pytest.approx(0.02 + height)


def test_masks_say_which_pixels_show_which_object(rig: Rig) -> None:
    seen = rig.look(3, [(105, 145), (60, 60)])
    masks = rig.masks()
    assert (masks.number, masks.view) == (1, 3)
    assert_array_equal(masks.colour[65, 65], RED)
    assert_array_equal(np.unique(masks.objects), [-1, 0, 1])
    for segment in seen.segments:
        v, u = np.nonzero(masks.objects == segment.number)
        assert_allclose(segment.pixels.centroid.coords[0], [u.mean(), v.mean()], atol=0.3)
    assert_allclose(masks.depth[120, 160], 0.53)
    assert_array_equal(masks.X_WC, X_WC)


def test_a_view_is_segmented_once(rig: Rig) -> None:
    first = rig.look(1, [(105, 145)])
    assert rig.look(1, []) is first
    nothing = rig.look(3, [])
    assert nothing == Segments(number=2, time=1.0, table=first.table, bare=nothing.bare)
    assert nothing.bare.area > first.bare.area > 0.0  # Without objects it shows more of the table.


def test_objects_keep_their_numbers_also_over_images_that_do_not_show_them(rig: Rig) -> None:
    first = rig.look(1, [(60, 60), (150, 200)])
    rig.look(2, [(150, 200)])
    again = rig.look(3, [(150, 205), (60, 65), (60, 200)])
    places = {segment.number: segment.centroid for segment in again.segments}
    assert sorted(places) == [0, 1, 2]
    for segment in first.segments:
        assert np.linalg.norm(places[segment.number] - segment.centroid) < 0.015


def test_what_the_camera_has_left_behind_is_still_there(rig: Rig) -> None:
    (seen,) = rig.look(1, [(60, 60)]).segments
    elsewhere = rig.look(2, [(100, 100)], aside=0.25)
    assert [(s.number, s.is_cut) for s in elsewhere.segments] == [(1, False), (0, True)]
    assert elsewhere.segments[1].contour == seen.contour
    assert rig.masks().objects.max() == 1
    assert rig.look(3, []).segments == ()  # Both have been taken away meanwhile.


def test_what_the_robot_hides_and_what_is_beside_the_region_is_left_out(rig: Rig) -> None:
    assert rig.look(1, [(105, 145)], robot=True).segments == ()
    assert rig.look(2, [(5, 5)]).segments == ()  # At y = .21 m.


def test_without_an_image_of_the_robot_all_is_seen() -> None:
    rig = Rig()
    rig.look(0, [(105, 145)])
    fresh = rig.system.CreateDefaultContext()
    for port in ("color_measured", "depth_measured"):
        value = rig.system.GetInputPort(port).Eval(rig.context)
        rig.system.GetInputPort(port).FixValue(fresh, AbstractValue.Make(value))
    rig.system.GetInputPort("looked").FixValue(fresh, [1.0])
    rig.system.ExecuteForcedEvents(fresh)
    assert len(rig.system.GetOutputPort("segments").Eval(fresh).segments) == 1


def test_ports_are_those_documented(rig: Rig) -> None:
    for kind, count in (
        ("input", rig.system.num_input_ports()),
        ("output", rig.system.num_output_ports()),
    ):
        get = rig.system.get_input_port if kind == "input" else rig.system.get_output_port
        declared = [get(k).get_name() for k in range(count)]
        assert declared == documented_ports(Segmenter.__doc__, kind)


def test_impossible_values_are_refused() -> None:
    network: Any = Red("can")
    with pytest.raises(ValueError, match="reach"):
        Segmenter(network, CAMERA, TABLE, REGION, {}, SegmenterConfig(reach=-1.0), 0.1)
