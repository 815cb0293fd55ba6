"""Blocks of an image, and the law by which most of them change."""

import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from crossmodal.systems.monitoring.background import (
    Background,
    block_means,
    law_of_most,
    off_the_robot,
    remember,
)


def test_the_law_is_that_of_most_whatever_the_others_do() -> None:
    rng = np.random.default_rng(0)
    A = np.column_stack([np.ones(100), rng.uniform(0.0, 10.0, 100)])
    change = A @ [3.0, -0.5] + 0.01 * rng.standard_normal(100)
    change[:30] += rng.uniform(5.0, 20.0, 30)
    law, follows = law_of_most(A, change, 0.1)
    assert_allclose(law, [3.0, -0.5], atol=0.05)
    assert_array_equal(follows, np.arange(100) >= 30)


def test_a_block_counts_where_enough_of_it_is_seen() -> None:
    values = np.arange(400.0).reshape(20, 20)
    where = np.zeros((20, 20), bool)
    where[:10, :10] = True
    where[:5, 10:] = True
    means = block_means([values, np.ones((20, 20))], where, 0.6)
    assert_allclose(means, [[values[:10, :10].mean(), 1.0]])


def test_only_what_shows_for_the_first_time_is_remembered() -> None:
    background = Background(np.array([[1.0, 0.0]]))
    seen = np.array([[True, True]])
    assert_array_equal(remember(background, np.array([[5.0, 6.0]]), seen).first, [[1.0, 6.0]])
    assert_array_equal(background.first, [[1.0, 0.0]])


def test_an_unknown_robot_is_nowhere() -> None:
    assert off_the_robot(None, (2, 3)).all()
