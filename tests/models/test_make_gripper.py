"""The gripper's file is what its script makes, and its layout is what it says."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from crossmodal.maths.arrays import Array
from crossmodal.models.gripper_taxels import (
    ARRAYS,
    PITCH,
    RADIUS,
    THICKNESS,
    WIDTH,
    GripperTaxels,
    gripper_taxels,
)
from crossmodal.models.make_gripper import GRIPPER_FILE, sdf


@pytest.fixture(scope="module")
def taxels() -> GripperTaxels:
    return gripper_taxels()


def test_the_file_is_what_the_script_makes() -> None:
    assert GRIPPER_FILE.read_text(encoding="utf-8") == sdf()


def test_there_are_140_taxels_in_8_arrays(taxels: GripperTaxels) -> None:
    assert np.bincount(taxels.array).tolist() == [24, 24, 6, 16] * 2
    assert np.bincount(taxels.finger).tolist() == [70, 70]
    assert len(set(taxels.names)) == 140
    counts = [24, 24, 6, 16] * 2
    assert list(taxels.names) == [
        f"taxel_{array}_{k}" for array, n in zip(ARRAYS, counts, strict=True) for k in range(n)
    ]


@pytest.mark.parametrize("array", ARRAYS)
def test_neighbours_have_their_distance(taxels: GripperTaxels, array: str) -> None:
    p = taxels.p_FT[taxels.array == ARRAYS.index(array)]
    between = np.linalg.norm(p[:, None] - p, axis=-1) + np.diag(np.full(len(p), np.inf))
    expected = 0.008 if array.endswith("tip") else PITCH
    assert_allclose(between.min(axis=1), expected, atol=1e-9)


def test_no_two_taxels_of_a_finger_are_one(taxels: GripperTaxels) -> None:
    p = taxels.p_FS[taxels.finger == 0]
    between = np.linalg.norm(p[:, None] - p, axis=-1) + np.diag(np.full(len(p), np.inf))
    assert between.min() > 0.0045


def test_closed_fingers_meet_in_the_middle_and_end_at_the_origin(taxels: GripperTaxels) -> None:
    p_ET = taxels.p_ET(np.zeros(2))
    inside = [ARRAYS.index(f"left_{part}") for part in ("inner", "phalange")]
    assert_allclose(p_ET[np.isin(taxels.array, inside), 0], 0.0, atol=1e-12)
    outer = taxels.array == ARRAYS.index("right_outer")
    assert_allclose(p_ET[outer, 0], -THICKNESS)
    tips = np.isin(taxels.array, [ARRAYS.index("left_tip"), ARRAYS.index("right_tip")])
    assert_allclose(p_ET[tips, 2], 0.0, atol=1e-12)
    assert (p_ET[~tips, 2] < 0.0).all()
    spheres = taxels.p_FS[tips]
    assert_allclose(np.ptp(spheres, axis=0)[:2] + 2 * RADIUS, [2 * THICKNESS, WIDTH])


def test_open_fingers_have_moved_apart(taxels: GripperTaxels) -> None:
    moved = taxels.p_ET(np.array([0.02, 0.05])) - taxels.p_ET(np.zeros(2))
    expected: Array = np.where(taxels.finger[:, None] == 0, [0.02, 0, 0], [-0.05, 0, 0])
    assert_allclose(moved, expected, atol=1e-12)
    assert_allclose(np.linalg.norm(taxels.n_E, axis=1), 1.0)
