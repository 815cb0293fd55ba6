import numpy as np
import pytest
from numpy.testing import assert_array_equal

from crossmodal.systems.segmentation.network_input import CLASSES
from crossmodal.systems.segmentation.objects import (
    ObjectsConfig,
    SeenObject,
    covered_share,
    seen_objects,
)

CAMERA_HEIGHT = 0.6  # Above the table; it looks straight down.
CAN, SPONGE, GLASS, OTHER = (
    CLASSES.index(name) for name in ("can", "sponge", "wineglass", "other")
)


class Scene:
    """An image of boxes, each painted over those before."""

    def __init__(self) -> None:
        self.classes = np.zeros((240, 320), int)
        self.heights = np.zeros((240, 320))
        self.masked = np.zeros((240, 320), bool)

    def add(self, name: int, rows: slice, columns: slice, height: float) -> "Scene":
        self.classes[rows, columns] = name
        self.heights[rows, columns] = height
        return self

    def objects(self, **lengths: float) -> list[SeenObject]:
        depth = CAMERA_HEIGHT - self.heights
        return seen_objects(
            self.classes, depth, self.heights, self.masked, 300.0, lengths, ObjectsConfig()
        )


def names(found: list[SeenObject]) -> list[str]:
    return sorted(one.name for one in found)


def test_each_class_is_an_object_with_its_own_pixels() -> None:
    scene = Scene().add(CAN, np.s_[20:60], np.s_[20:60], 0.1)
    scene.add(SPONGE, np.s_[60:100], np.s_[20:60], 0.03)
    found = scene.objects()
    assert names(found) == ["can", "sponge"]
    for one in found:
        assert_array_equal(one.mask, scene.classes == CLASSES.index(one.name))


def test_two_objects_of_a_class_with_table_between_them_are_two() -> None:
    scene = Scene().add(CAN, np.s_[20:60], np.s_[20:60], 0.1)
    scene.add(CAN, np.s_[20:60], np.s_[64:100], 0.1)
    assert names(scene.objects()) == ["can", "can"]


def test_two_objects_of_a_class_one_before_the_other_are_two_by_the_step_of_depth() -> None:
    scene = Scene().add(SPONGE, np.s_[20:60], np.s_[20:60], 0.03)
    scene.add(SPONGE, np.s_[20:60], np.s_[60:100], 0.13)
    found = scene.objects()
    assert names(found) == ["sponge", "sponge"]
    # All pixels belong to one of them, those at the step, too.
    assert_array_equal(found[0].mask ^ found[1].mask, scene.classes == SPONGE)


def test_a_small_step_of_depth_is_a_part_of_the_object() -> None:
    scene = Scene().add(SPONGE, np.s_[20:60], np.s_[20:60], 0.03)
    scene.add(SPONGE, np.s_[20:60], np.s_[60:100], 0.07)
    assert names(scene.objects()) == ["sponge"]


def test_the_shadow_of_the_nearer_object_hides_no_step() -> None:
    scene = Scene().add(SPONGE, np.s_[20:60], np.s_[20:60], 0.03)
    scene.add(SPONGE, np.s_[20:60], np.s_[60:100], 0.13)
    scene.heights[20:60, 52:60] = np.nan
    assert names(scene.objects()) == ["sponge", "sponge"]


def test_steps_of_depth_behind_glass_do_not_part_it() -> None:
    scene = Scene().add(GLASS, np.s_[20:60], np.s_[20:100], 0.0)
    scene.heights[20:60, 60:70] = 0.2
    assert names(scene.objects()) == ["wineglass"]


def test_what_another_object_lies_across_is_one_object() -> None:
    scene = Scene().add(SPONGE, np.s_[20:60], np.s_[20:100], 0.03)
    scene.add(CAN, np.s_[10:70], np.s_[50:60], 0.1)
    found = scene.objects()
    assert names(found) == ["can", "sponge"]
    (sponge,) = (one.mask for one in found if one.name == "sponge")
    assert_array_equal(sponge, scene.classes == SPONGE)


def test_what_lies_on_both_sides_of_something_lower_is_two_objects() -> None:
    scene = Scene().add(SPONGE, np.s_[20:60], np.s_[20:100], 0.03)
    scene.add(CAN, np.s_[10:70], np.s_[50:60], 0.01)
    assert names(scene.objects()) == ["can", "sponge", "sponge"]


def test_a_small_part_belongs_to_a_large_one_if_both_fit_into_one_object() -> None:
    scene = Scene().add(SPONGE, np.s_[20:60], np.s_[20:60], 0.03)
    scene.add(SPONGE, np.s_[20:30], np.s_[70:80], 0.03)  # 6 by 4 cm in all, with table between.
    scene.add(SPONGE, np.s_[20:60], np.s_[100:140], 0.03)
    assert names(scene.objects(sponge=0.15)) == ["sponge", "sponge"]
    far = Scene().add(SPONGE, np.s_[20:60], np.s_[20:60], 0.03)
    far.add(SPONGE, np.s_[20:30], np.s_[170:180], 0.03)
    assert names(far.objects(sponge=0.15)) == ["sponge", "sponge"]


def test_a_speck_is_no_part_of_an_object_that_it_is_apart_from() -> None:
    scene = Scene().add(CAN, np.s_[20:60], np.s_[20:60], 0.1)
    scene.add(CAN, np.s_[100:106], np.s_[40:46], 0.02)
    (found,) = scene.objects(can=1.0)
    assert not found.mask[100:].any()


def test_the_class_of_unknown_objects_has_no_name() -> None:
    assert names(Scene().add(OTHER, np.s_[20:60], np.s_[20:60], 0.1).objects()) == [""]


def test_what_rises_above_the_table_is_an_object_even_if_the_network_sees_none() -> None:
    found = Scene().add(0, np.s_[20:60], np.s_[20:60], 0.05).objects()
    assert names(found) == [""]
    assert found[0].mask[22:58, 22:58].all()


def test_a_rim_that_the_network_leaves_of_an_object_is_no_object() -> None:
    scene = Scene().add(CAN, np.s_[20:100], np.s_[20:100], 0.1)
    scene.classes[20:100, 96:100] = 0
    assert names(scene.objects()) == ["can"]


def test_what_is_too_small_and_what_shows_the_robot_is_no_object() -> None:
    scene = Scene().add(CAN, np.s_[20:25], np.s_[20:25], 0.1)
    scene.add(SPONGE, np.s_[100:200], np.s_[100:200], 0.2)
    scene.masked[90:210, 90:210] = True
    assert scene.objects() == []


def test_without_any_depth_classes_are_still_objects() -> None:
    scene = Scene().add(CAN, np.s_[20:60], np.s_[20:60], 0.1)
    scene.heights[:] = np.nan
    assert names(scene.objects()) == ["can"]


def test_an_outline_is_covered_where_another_object_is_before_it() -> None:
    scene = Scene().add(SPONGE, np.s_[50:90], np.s_[50:90], 0.03)
    scene.add(CAN, np.s_[60:80], np.s_[90:120], 0.1)  # Beside half of one of four sides.
    depth = CAMERA_HEIGHT - scene.heights
    sponge, can = scene.classes == SPONGE, scene.classes == CAN
    assert covered_share(sponge, can, depth, 0.01) == pytest.approx(1 / 8, abs=0.02)
    assert covered_share(can, sponge, depth, 0.01) == 0.0
    # Through holes in depth it is told by what is nearest.
    depth[sponge & (np.arange(320) % 4 > 0)] = 0.0
    assert covered_share(sponge, can, depth, 0.01) == pytest.approx(1 / 8, abs=0.02)


def test_a_small_thing_of_no_class_within_an_object_is_a_part_of_it() -> None:
    scene = Scene().add(CAN, np.s_[20:80], np.s_[20:80], 0.1)
    scene.add(OTHER, np.s_[20:36], np.s_[40:56], 0.12)  # At its rim.
    (can,) = scene.objects()
    assert can.name == "can"
    assert_array_equal(can.mask, scene.classes > 0)


def test_a_thing_of_no_class_beside_an_object_or_large_upon_it_is_a_thing() -> None:
    scene = Scene().add(CAN, np.s_[20:80], np.s_[20:80], 0.1)
    scene.add(OTHER, np.s_[30:46], np.s_[72:90], 0.12)
    assert names(scene.objects()) == ["", "can"]
    scene = Scene().add(CAN, np.s_[20:80], np.s_[20:80], 0.1)
    scene.add(OTHER, np.s_[30:76], np.s_[30:76], 0.12)
    assert names(scene.objects()) == ["", "can"]
