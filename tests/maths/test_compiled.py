"""Compiling is told apart from running, and compiled code gives the same digits every time."""

import importlib
import pkgutil
import time

import numba
import numpy as np
import pytest
from numba.core.registry import CPUDispatcher
from numpy.testing import assert_array_equal

from crossmodal import maths, systems
from crossmodal.maths.compiled import assign, compilation_timed, hot


@pytest.mark.parametrize("package", [maths, systems])
def test_no_function_may_be_reordered_by_its_compiler(package: object) -> None:
    found = 0
    for module in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
        for name, value in vars(importlib.import_module(module.name)).items():
            if isinstance(value, CPUDispatcher):
                found += 1
                assert not value.targetoptions.get("fastmath"), f"{module.name}.{name}"
    assert found > 5


def test_only_the_first_call_of_a_function_compiles_and_it_is_announced_once() -> None:
    announced: list[bool] = []

    @numba.njit
    def double(x: float) -> float:
        return 2.0 * x

    @numba.njit
    def double_twice(x: float) -> float:
        return double(double(x))

    with compilation_timed(lambda: announced.append(True)) as first:
        began = time.perf_counter()
        assert double_twice(1.0) == 4.0
        passed = time.perf_counter() - began
    assert announced == [True]
    assert 0.0 < first.seconds <= passed
    with compilation_timed(lambda: announced.append(True)) as second:
        assert double_twice(2.0) == 8.0
    assert announced == [True]
    assert second.seconds == 0.0


def test_where_compiled_code_cannot_be_kept_the_remedy_is_named(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    locator = "numba.core.caching.UserProvidedCacheLocator"  # Finds no place by itself.
    monkeypatch.setattr(numba.config, "CACHE_LOCATOR_CLASSES", locator)
    monkeypatch.setattr(numba.config, "CACHE_DIR", "")
    with pytest.raises(PermissionError, match="set NUMBA_CACHE_DIR to a folder"):
        hot(lambda x: 2.0 * x)


@pytest.mark.parametrize("shape", [(5,), (3, 4)])
def test_an_array_is_overwritten_and_what_is_around_it_is_not(shape: tuple[int, ...]) -> None:
    values = np.arange(float(np.prod(shape))).reshape(shape)
    around = np.full([n + 2 for n in shape], -1.0)
    expected = around.copy()
    inside = tuple(slice(1, -1) for _ in shape)
    assign(around[inside], values)
    expected[inside] = values
    assert_array_equal(around, expected)
