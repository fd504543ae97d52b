"""Laws of a change: at its null it changes nothing, it undoes the difference, and earlier runs never see it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from diagnosis.linear import ROVER, driven, space_of, windows
from hypothesis import given
from hypothesis import strategies as st
from oracles.arms import arm_xml, robot_of
from oracles.rover_log import SIGMA

from residual_mpc.comparison.space import ChangeSpace, change_between, change_space, compose
from residual_mpc.diagnosis.data.dataset import Block, Dataset, build_dataset, joined
from residual_mpc.diagnosis.predict import replay
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.diagnosis.predict.space import Space
from residual_mpc.effects.effect import Parameter
from residual_mpc.effects.library import LIBRARY
from residual_mpc.models.settings import Knob, Settings, Term

DATA = windows(2, 10.0)
SPACE: ChangeSpace = change_space(space_of(DATA))
NUMBERS = [(e.name, p) for e in LIBRARY for p in e.parameters if not p.shape]
NAMES = [f"{effect}.{p.name}" for effect, p in NUMBERS]
FINITE = [p for _, p in NUMBERS if np.isfinite(p.null)]
OPEN = [p for _, p in NUMBERS if np.isinf(p.null)]

GAIN, DELAY, TRACK = ("actuator_gain", "gain"), ("command_delay", "delay"), ("track_width", "scale")


def own(effect: tuple[str, str], target: str | None = None) -> Knob:
    return Knob(effect[0], target, effect[1])


def change(effect: tuple[str, str], target: str | None = None) -> Knob:
    return own(effect, target)._replace(changed=True)


def values_of(settings: Settings) -> dict[str, np.ndarray]:
    """Every array that says how a robot behaves, by name."""
    effects = {f"{e}.{p}": v for e, ps in settings.effects.items() for p, v in ps.items()}
    return effects | {f"tune.{name}": v for name, v in settings.tuned.items()}


def assert_same(a: Settings, b: Settings) -> None:
    here, there = values_of(a), values_of(b)
    assert here.keys() == there.keys()
    for name, value in here.items():
        np.testing.assert_array_equal(value, there[name], err_msg=name)  # bit for bit


@pytest.mark.parametrize(("effect", "p"), NUMBERS, ids=NAMES)
def test_a_change_at_its_null_leaves_a_number_alone(effect: str, p: Parameter) -> None:
    for before in (0.25, 0.5, 0.8, 1.0, 1.7, 40.0):
        assert compose(p, before, p.null) == pytest.approx(before, rel=1e-15)
        if np.isfinite(p.null) or p.threshold:
            assert compose(p, before, p.null) == before
    assert compose(p, p.null, p.null) == p.null


@pytest.mark.parametrize("term", SPACE.candidates, ids=str)
def test_a_change_at_its_null_leaves_the_robot_alone(term: Term) -> None:
    """A limit's null, none, is outside its bounds: what is within does nothing on these runs."""
    numbers = {k: SPACE.null(k) for k in SPACE.knobs(term)}
    assert all(k.changed for k in numbers)
    common = {own(TRACK): 1.2, own(GAIN): 0.9, own(GAIN, "left"): 0.8}
    there = SPACE.settings([common])
    with_change = SPACE.settings([{**common, **numbers}])
    assert_same(with_change, there)
    assert with_change.others
    if np.isfinite(list(numbers.values())).all():
        assert_same(with_change.others[0], there)
    np.testing.assert_array_equal(predict(DATA, with_change.others[0]), predict(DATA, there))


@given(st.sampled_from(FINITE), st.floats(0.05, 20.0), st.floats(0.05, 20.0))
def test_composing_the_difference_gives_the_number_after(p: Parameter, before: float, after: float) -> None:
    assert compose(p, before, change_between(p, before, after)) == pytest.approx(after, rel=1e-9, abs=1e-9)
    assert change_between(p, before, compose(p, before, after)) == pytest.approx(after, rel=1e-9, abs=1e-9)


@given(st.sampled_from(OPEN), st.floats(0.05, 20.0))
def test_a_limit_or_spring_that_was_not_there_is_its_own_change(p: Parameter, after: float) -> None:
    assert compose(p, p.null, after) == after and change_between(p, p.null, after) == after


def test_limits_take_the_lower_one_and_springs_act_in_series() -> None:
    limit, spring = (next(p for p in OPEN if p.threshold is threshold) for threshold in (True, False))
    assert compose(limit, 3.0, 5.0) == compose(limit, 5.0, 3.0) == 3.0
    assert compose(spring, 30.0, 60.0) == pytest.approx(20.0)
    assert change_between(limit, 5.0, 4.0) == pytest.approx(0.8)  # a ratio, of what was there


def test_a_change_on_all_targets_reaches_those_with_values_of_their_own() -> None:
    common = {own(GAIN): 0.9, own(GAIN, "left"): 0.5}
    after = SPACE.later({**common, change(GAIN): 1.1})
    assert after == pytest.approx({own(GAIN): 0.99, own(GAIN, "left"): 0.55})
    later = SPACE.settings([{**common, change(GAIN): 1.1}]).others[0]
    np.testing.assert_allclose(later.effects["actuator_gain"]["gain"], [[0.55, 0.99]])


def test_a_change_on_one_target_starts_from_what_acts_on_all() -> None:
    after = SPACE.later({own(DELAY): 0.05, change(DELAY, "right"): 0.02})
    assert after == pytest.approx({own(DELAY): 0.05, own(DELAY, "right"): 0.07})


def test_the_numbers_after_stay_within_the_effects_bounds() -> None:
    assert SPACE.later({own(DELAY): 0.05, change(DELAY): -0.2})[own(DELAY)] == SPACE.bounds(own(DELAY))[0] < 0.05
    low, high = SPACE.bounds(change(DELAY))
    assert low == -high  # a change may take away as much as there can be
    low, high = SPACE.bounds(change(GAIN))
    assert 0.0 < low < 1.0 < high


def test_values_after_are_there_only_where_something_changed() -> None:
    common = {own(TRACK): 1.2}
    assert SPACE.settings([common, {}]).others == ()
    both = SPACE.settings([common, {**common, change(TRACK): 1.1}])
    assert both.others
    np.testing.assert_allclose(both.effects["track_width"]["scale"].ravel(), [1.2, 1.2])
    np.testing.assert_allclose(both.others[0].effects["track_width"]["scale"].ravel(), [1.2, 1.32])


def test_probes_of_a_change_go_both_ways() -> None:
    term = next(t for t in SPACE.candidates if t.effect == "track_width")
    sizes = [v for probe in SPACE.probes(term) for v in probe.values()]
    assert min(sizes) < 1.0 < max(sizes)


def test_probes_of_a_changed_limit_go_beyond_that_of_the_model_where_it_is_reached(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The nearest limit below stays among them: a motor that has become a little weaker is the usual change."""
    term = next(t for t in SPACE.candidates if t.effect == "saturation")
    plain = [v for probe in SPACE.probes(term) for v in probe.values()]
    own = max(plain) / 0.96  # the first probe, of the largest output
    monkeypatch.setattr(ChangeSpace, "reached_limit", lambda *_: own)
    raised = [v for probe in SPACE.probes(term) for v in probe.values()]
    assert raised[:-1] == plain and max(plain) < own < raised[-1]


def two_sets() -> Dataset:
    """Windows of four runs, the last two of which are the later set."""
    runs = [driven(f"r{k}", 10.0, k) for k in range(4)]
    parts = []
    for later in (False, True):
        begun = [np.arange(0.0, 9.0, 1.0) if (k >= 2) is later else np.zeros(0) for k in range(4)]
        part = build_dataset(runs, [ROVER] * 4, SIGMA, 1.0, begun)
        parts.append(replace(part, blocks=tuple(replace(b, group=int(later)) for b in part.blocks)))
    return joined(parts)


def test_earlier_windows_are_predicted_as_if_nothing_had_changed() -> None:
    data = two_sets()
    common = {own(TRACK): 1.2}
    changed = {**common, change(TRACK): 1.3, change(DELAY): 0.1}
    without, with_change = predict(data, SPACE.settings([common, common])), predict(data, SPACE.settings([changed] * 2))
    earlier = data.run < 2
    np.testing.assert_array_equal(with_change[:, earlier], without[:, earlier])
    whole = predict(data, SPACE.settings([SPACE.later(changed)]))[0]
    np.testing.assert_array_equal(with_change[0, ~earlier], whole[~earlier])
    assert np.nanmax(np.abs(with_change[:, ~earlier] - without[:, ~earlier])) > 0.01


class Looser:
    """The rover with other limits of its track."""

    def __init__(self, low: float, high: float) -> None:
        self.limits_of_track = (low, high)

    def __getattr__(self, name: str) -> object:
        return getattr(ROVER, name)

    def bounds(self, effect: str, parameter: str, target: str | None) -> tuple[float, float]:
        return self.limits_of_track if effect == "track_width" else ROVER.bounds(effect, parameter, target)


def test_each_set_has_the_limits_of_its_own_nominal_models() -> None:
    """Those that hold for all models of the set: a later model with more damping lets more of it be taken away."""
    earlier, later = [Looser(0.8, 1.2), Looser(0.9, 1.5)], [Looser(0.5, 2.0)]
    space = change_space(space_of(DATA), earlier, later)  # type: ignore[arg-type]
    assert space.bounds(own(TRACK)) == (0.9, 1.2)
    assert space.later_bounds(own(TRACK)) == (0.5, 2.0)
    values = {own(TRACK): 1.0, change(TRACK): 0.6}
    assert space.later(values) == {own(TRACK): 0.6}
    assert space.bounds(own(GAIN)) == SPACE.bounds(own(GAIN))


def test_hypotheses_that_differ_on_the_later_runs_alone_are_replayed_once_on_the_others(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    data = two_sets()
    hypotheses = [{own(GAIN): 0.9}, *({own(GAIN): 0.9, change(GAIN): g} for g in (0.8, 0.7, 0.8)), {own(GAIN): 0.7}]
    each = np.concatenate([predict(data, SPACE.settings([h])) for h in hypotheses])
    rows: list[tuple[bool, int]] = []
    plain = replay._predict_block

    def counted(data: Dataset, block: Block, settings: Settings, nudge: replay.Start | None) -> np.ndarray:
        rows.append((block.group, settings.rows))
        return plain(data, block, settings, nudge)

    monkeypatch.setattr(replay, "_predict_block", counted)
    np.testing.assert_array_equal(predict(data, SPACE.settings(hypotheses)), each)
    assert rows == [(b.group, 4 if b.group else 2) for b in data.blocks]


def test_a_new_stop_may_be_where_the_joints_of_the_later_set_end(tmp_path: Path) -> None:
    """The runs before went beyond it."""
    robot = robot_of(tmp_path, arm_xml())
    references = {("highest", "j1"): 1.2, ("lowest", "j1"): -0.9}
    stop = Term("end_stop", "j1")
    whole = Space(robot, {"end_stop": ("j1", "j2")}, (stop,), (), references, {})
    ends = {("highest", "j1"): 0.4, ("lowest", "j1"): -0.3}
    for space, expected in ((change_space(whole), [1.2, -0.9]), (change_space(whole, later_ends=ends), [0.4, -0.3])):
        probes = space.probes(stop._replace(changed=True))
        assert sorted((v for probe in probes for v in probe.values()), reverse=True) == expected
