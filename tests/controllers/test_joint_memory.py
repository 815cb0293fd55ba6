"""What is remembered of the perceived joint."""

import numpy as np
from numpy.testing import assert_allclose

from controllers.joint_memory import remember

NOTHING = np.append(np.full(14, np.nan), 0.0)
S = np.array([0.0, 0, 1, 0.2, -0.1, 0])


def seen(q: float, sign: float = 1.0) -> np.ndarray:
    return np.concatenate([sign * S, [sign * q, sign * 0.02], sign * S])


def test_a_gap_in_perception_is_bridged() -> None:
    memory = remember(NOTHING, seen(0.1), held=True)
    memory = remember(memory, np.full(14, np.nan), held=True)
    assert_allclose(memory[6], 0.1)
    assert_allclose(memory[:6], S)


def test_an_axis_that_turns_around_keeps_its_side() -> None:
    memory = remember(NOTHING, seen(0.1), held=True)
    memory = remember(memory, seen(0.11, sign=-1.0), held=True)
    assert_allclose(memory[:14], seen(0.11))


def test_after_another_grasp_the_configuration_goes_on_from_the_last_one() -> None:
    memory = remember(NOTHING, np.full(14, np.nan), held=False)
    memory = remember(memory, seen(0.1), held=True)
    memory = remember(memory, seen(0.1), held=False)
    memory = remember(memory, np.full(14, np.nan), held=True)
    assert_allclose(memory[6], 0.1)
    memory = remember(memory, seen(-0.03), held=True)
    assert_allclose(memory[6], 0.07)
