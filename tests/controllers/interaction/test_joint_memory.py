"""What is remembered of the perceived joint."""

import numpy as np
from numpy.testing import assert_allclose

from crossmodal.controllers.interaction import joint_memory

NOTHING = np.concatenate([np.full(14, np.nan), np.zeros(2)])
PERIOD, PATIENCE = 0.01, 0.5
S = np.array([0.0, 0, 1, 0.2, -0.1, 0])


def seen(q: float, sign: float = 1.0) -> np.ndarray:
    return np.concatenate([sign * S, [sign * q, sign * 0.02], sign * S])


def remember(memory: np.ndarray, seen: np.ndarray, held: bool) -> np.ndarray:
    return joint_memory.remember(memory, seen, held, PERIOD, PATIENCE)


def test_a_gap_in_perception_is_bridged() -> None:
    memory = remember(NOTHING, seen(0.1), held=True)
    memory = remember(memory, np.full(14, np.nan), held=True)
    assert_allclose(memory[6], 0.1)
    assert_allclose(memory[:6], S)
    assert np.isnan(memory[7]), "what is only remembered has no rate"


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


def test_a_passing_belief_in_another_type_is_not_followed_but_a_lasting_one_is() -> None:
    slide = np.concatenate([np.zeros(3), [1.0, 0, 0], [0.5, 0.0], np.zeros(6)])
    memory = remember(NOTHING, seen(0.1), held=True)
    for _ in range(30):
        memory = remember(memory, slide, held=True)
    memory = remember(memory, seen(0.11), held=True)
    assert_allclose(memory[6], 0.11)
    for _ in range(60):
        memory = remember(memory, slide, held=True)
    assert_allclose(memory[6], 0.5)
