"""Which object in an image is the one that is sought."""

from dataclasses import replace

import numpy as np
import pytest

from crossmodal.systems.port_values import Bodies, Segment
from crossmodal.systems.pose.target_segment import target_segment
from tests.systems.declutter.scenes import image, rectangle

PLACE, REACH = np.array([0.5, 0.1]), 0.04
SPRAY = rectangle(3, "spray", (0.51, 0.1))
CLEANER = rectangle(4, "cleaner", (0.51, 0.1), (0.06, 0.06))
BODY = np.array([[x, y, z] for x in (0.48, 0.52) for y in (0.08, 0.12) for z in (0.0, 0.1)])


def found(*segments: Segment, others: Bodies = (), is_glass: bool = False) -> int | None:
    target = target_segment(image(*segments), "spray", PLACE, REACH, others, is_glass)
    return None if target is None else target.number


def test_it_is_the_one_of_its_class_that_is_where_it_should_be() -> None:
    larger = rectangle(1, "spray", (0.7, 0.1), (0.1, 0.1))
    assert found(larger, SPRAY) == 3
    assert found(SPRAY, CLEANER) == 3
    beside = rectangle(5, "spray", (0.55, 0.1))  # From 3 cm beside the place on.
    assert found(beside) == 5
    assert found(larger) is None


def test_of_several_it_is_the_one_that_covers_most() -> None:
    cap = rectangle(1, "spray", (0.5, 0.12), (0.02, 0.02))
    assert found(cap, SPRAY) == found(SPRAY, cap) == 3


@pytest.mark.parametrize("name", ["cleaner", ""])
def test_what_covers_its_place_is_it_whatever_it_is_called(name: str) -> None:
    assert found(replace(CLEANER, name=name)) == 4
    far = rectangle(1, "spray", (0.7, 0.1))
    assert found(far, replace(CLEANER, name=name)) == 4
    assert found(rectangle(4, name, (0.55, 0.1))) is None  # That is beside the place.


def test_what_is_known_to_be_another_object_is_not_it() -> None:
    assert found(CLEANER, others=(BODY,)) is None
    assert found(CLEANER, others=(BODY + np.array([0.2, 0.0, 0.0]),)) == 4
    assert found(SPRAY, others=(BODY,)) == 3


def test_what_is_taken_for_glass_or_should_be_is_not_it() -> None:
    assert found(replace(CLEANER, is_glass=True)) is None
    assert found(CLEANER, is_glass=True) is None
    assert found(SPRAY, is_glass=True) == 3
