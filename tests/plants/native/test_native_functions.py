"""The elementary functions of compiled programs, beside numpy's."""

from __future__ import annotations

from ctypes import CFUNCTYPE, c_void_p

import numpy as np
import pytest

from plants.mujoco_robot.native.compiled import engine_of
from plants.mujoco_robot.native.elementary import operations
from plants.mujoco_robot.native.lanes import load, store
from plants.mujoco_robot.native.program import LANES, Program


def compiled(name: str, x: np.ndarray) -> np.ndarray:
    """One function of vectors, LANES numbers at a time."""
    p = Program()
    store(p, getattr(operations(p), name)(load(p, "%x", 0)), "%y", 0)
    engine, address = engine_of(p.text("f", ["ptr noalias %x", "ptr noalias %y"]), 1, "f")
    function = CFUNCTYPE(None, c_void_p, c_void_p)(address)
    y = np.empty_like(x)
    for k in range(0, len(x), LANES):
        function(x[k:].ctypes.data, y[k:].ctypes.data)
    del engine  # which owns the function
    return y


@pytest.mark.parametrize("name", ["sin", "cos"])
def test_sine_and_cosine_to_the_last_digits(name: str) -> None:
    turns = np.pi * np.arange(-200, 200) / 4.0
    x = np.concatenate([np.linspace(-50.0, 50.0, 40_000), turns, np.linspace(-1e5, 1e5, 4_000)])
    x = np.concatenate([x, np.zeros(-len(x) % LANES)])
    assert np.abs(compiled(name, x) - getattr(np, name)(x)).max() < 3e-16


def test_the_exponential_to_the_last_digits() -> None:
    x = np.linspace(-700.0, 700.0, 40_000)
    np.testing.assert_allclose(compiled("exp", x), np.exp(x), rtol=5e-16)
    assert compiled("exp", np.full(LANES, -1e4))[0] < 1e-300
    assert compiled("exp", np.zeros(LANES))[0] == 1.0


def test_what_is_not_compiled_says_so() -> None:
    p = Program()
    x = load(p, "%x", 0)
    with pytest.raises(NotImplementedError, match="power 3"):
        x**3
    with pytest.raises(NotImplementedError, match="arctan2"):
        operations(p).arctan2(x, x)


@pytest.mark.parametrize("name", ["absolute", "sign", "sqrt"])
def test_the_others_exactly(name: str) -> None:
    x = np.linspace(-3.0, 3.0, 800) if name != "sqrt" else np.linspace(0.0, 3.0, 800)
    np.testing.assert_array_equal(compiled(name, x), getattr(np, name)(x))
