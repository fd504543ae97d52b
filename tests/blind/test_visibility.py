"""How clearly runs show a change, and the sizes that are drawn by it."""

from dataclasses import replace

import numpy as np
import pytest

from residual_mpc.blind.recorded.kinds.kind import Kind
from residual_mpc.blind.recorded.recipe import Recipe, draw
from residual_mpc.blind.recorded.sizing import FAINTEST, Sized
from residual_mpc.blind.recorded.visibility import WindowErrors, visibility
from residual_mpc.errors import BadInput


def errors(rng: np.random.Generator, runs: int, windows: int = 4, size: float = 1.0) -> WindowErrors:
    """White errors of (runs * windows, 10 parts, 2 channels), half of the runs in the later half."""
    count = runs * windows
    key = np.column_stack([np.repeat(np.arange(runs), windows), np.tile(np.arange(windows), runs)])
    return WindowErrors(key, key[:, 0] >= runs // 2, key[:, 1].astype(float), size * rng.normal(size=(count, 10, 2)))


def test_the_visibility_is_that_of_a_z_test_of_the_units():
    """With a constant shift d in n values of deviation 1 per unit, z = d sqrt(n) / sqrt(1/U1 + 1/U2)."""
    rng, shift = np.random.default_rng(0), 0.1
    found = []
    for _ in range(40):
        one = errors(rng, 40)
        found.append(visibility(one, replace(one, errors=one.errors + shift)))
    # units of equal size have a weight of one half each, in the scatter and in the count alike
    assert np.median(found) == pytest.approx(shift * np.sqrt(80.0) / np.sqrt(2.0 / 20.0), rel=0.15)


def test_what_runs_scatter_by_counts_and_what_they_share_does_not():
    rng = np.random.default_rng(1)
    one = errors(rng, 40)
    shared = replace(one, errors=one.errors + 5.0)
    scattered = replace(one, errors=one.errors + rng.normal(size=40)[one.key[:, 0], None, None])
    z = [visibility(e, replace(e, errors=e.errors + 0.1)) for e in (one, shared, scattered)]
    assert z[1] == pytest.approx(z[0], rel=1e-6)
    assert z[2] < 0.3 * z[0]


def test_a_change_that_no_window_shows_has_none():
    one = errors(np.random.default_rng(2), 12)
    assert visibility(one, one) == 0.0


def test_windows_that_a_change_removes_are_left_out():
    one = errors(np.random.default_rng(3), 40)
    fewer = WindowErrors(one.key[1:], one.later[1:], one.start[1:], one.errors[1:] + 0.1)
    whole = visibility(one, replace(one, errors=one.errors + 0.1))
    assert visibility(one, fewer) == pytest.approx(whole, rel=0.1)


def kind(effect: str) -> Kind:
    return Kind(effect, "log", "", effect, lambda half: (None,), lambda *_: {"x": 1.0}, lambda half, *_: half)


RECIPE = Recipe("case-0001", 0, 1, 0, 3, False)


def test_a_change_that_the_runs_cannot_show_is_not_drawn():
    carried = ((kind("a"), (None,)), (kind("b"), (None,)))

    def size(of: Kind, *_: object) -> Sized | None:
        return None if of.effect == "a" else Sized({"x": 2.0}, FAINTEST)

    (change,) = draw(carried, RECIPE, np.random.default_rng(0), size)
    assert (change.kind.effect, change.sizes, change.visibility) == ("b", {"x": 2.0}, FAINTEST)


def test_runs_that_show_no_kind_are_refused():
    with pytest.raises(BadInput, match="even the largest change of every kind is invisible"):
        draw(((kind("a"), (None,)),), RECIPE, np.random.default_rng(0), lambda *_: None)
