"""How much of a target is hidden in scenes of which one knows it."""

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw

from crossmodal.plants.goods.clutter_density import ClutterDensity, measure_density, nearer_than

CAN = RigidTransform(np.array([0.5, 0.0, 0.0]))  # 115 mm high, 33 mm of radius.


def density(**others: RigidTransform) -> ClutterDensity:
    return measure_density({"can": CAN, **others}, "can")


def test_a_target_alone_is_not_hidden() -> None:
    assert density() == ClutterDensity(
        hidden_above=0.0, hidden_60=0.0, hidden_35=0.0, touching=0, touching_target=0
    )


def test_a_box_above_hides_all_from_above_and_nothing_from_low() -> None:
    found = density(black_box=RigidTransform(np.array([0.5, 0.0, 0.3])))
    assert found.hidden_above == 1.0
    assert found.hidden_35 == 0.0
    assert found.touching == found.touching_target == 0


def test_a_box_over_one_half_hides_half() -> None:
    # Its side, 80 mm from its middle, is above the can's axis.
    found = density(black_box=RigidTransform(np.array([0.58, 0.0, 0.12])))
    assert found.hidden_above == pytest.approx(0.5, abs=0.06)


def test_a_transparent_box_hides_too() -> None:
    over = RigidTransform(RollPitchYaw(np.pi, 0.0, 0.0), np.array([0.5, 0.0, 0.25]))
    assert density(transparent_box=over).hidden_above == 1.0


def test_pairs_touch_up_to_a_millimetre() -> None:
    # The box's side is 80 mm from its middle, the can's 33 mm: half a millimetre is between them.
    beside = RigidTransform(np.array([0.5 + 0.08 + 0.033 + 5e-4, 0.0, 0.0]))
    on_top = RigidTransform(np.array([0.5 + 0.08 + 0.033, 0.0, 0.06]))
    apart = RigidTransform(np.array([0.5, 0.3, 0.0]))
    found = density(black_box=beside, sponge=on_top, marker=apart)
    assert (found.touching, found.touching_target) == (2, 1)
    assert (density(black_box=beside).touching, density(black_box=beside).touching_target) == (1, 1)
    assert density(marker=apart).touching == 0


def test_the_target_must_be_in_the_scene() -> None:
    with pytest.raises(ValueError, match="no target 'oil' in the scene; there are can"):
        measure_density({"can": CAN}, "oil")


def test_what_is_near_is_told_by_the_distance_between_surfaces() -> None:
    poses = {
        "can": CAN,
        "black_box": RigidTransform(np.array([0.5 + 0.08 + 0.033 + 0.05, 0.0, 0.0])),
        "oil": RigidTransform(np.array([0.5, 0.6, 0.0])),
    }
    assert nearer_than(poses, "can", 0.06) == ["black_box"]
    assert nearer_than(poses, "can", 0.04) == []
    assert nearer_than(poses, "oil", 1.0) == ["black_box", "can"]
