"""The head-to-head's own parts: its truth against laws and an oracle, what it hands out, and what its page says."""

import json
from dataclasses import asdict, replace
from types import ModuleType

import numpy as np
import pytest

from benchmarks.head_to_head import page, toolbox
from benchmarks.head_to_head.files import HIDDEN, read_runs, write_case, write_model
from benchmarks.head_to_head.match import Match, alone, read
from benchmarks.head_to_head.ours import Diagnosed, Judged, understand
from benchmarks.head_to_head.servo import (
    CASES,
    GRAVITY,
    KP,
    LINK_COM,
    LINK_INERTIA,
    LINK_MASS,
    MOTIONS,
    SPREAD,
    TOOL,
    TUNED,
    Servo,
    command,
    draw,
    guess,
    simulate,
)
from benchmarks.head_to_head.toolbox import Fit

T = np.arange(400) * 0.01  # s


def held(level: float) -> np.ndarray:
    return np.where(T > 0, level, 0.0)


@pytest.mark.parametrize("payload", [0.0, 0.15])
def test_without_friction_the_servo_comes_to_rest_where_spring_and_weight_balance(payload):
    q = simulate(Servo(friction=0.0, payload=payload), T, held(0.5))[-1]
    weight = GRAVITY * (LINK_MASS * LINK_COM + payload * TOOL)
    assert KP * (0.5 - q) == pytest.approx(weight * np.sin(q), rel=1e-6)


def test_dry_friction_holds_what_it_can_and_no_more():
    servo = Servo(friction=0.3)
    assert not simulate(servo, T, held(0.9 * 0.3 / KP)).any()
    assert simulate(servo, T, held(1.2 * 0.3 / KP))[-1] > 0


def test_the_truth_is_the_equation_of_motion():
    """Against scipy's Runge-Kutta at a tight tolerance, piece by piece between the command's jumps; no dry friction."""
    from scipy.integrate import solve_ivp

    servo = Servo(friction=0.0, payload=0.15)
    u = command("multisine", T, np.random.default_rng(0))
    inertia = servo.armature + LINK_INERTIA + LINK_MASS * LINK_COM**2 + 0.15 * TOOL**2
    weight = GRAVITY * (LINK_MASS * LINK_COM + 0.15 * TOOL)
    state, wanted = np.zeros(2), [0.0]
    for target in u[:-1]:

        def rate(_, x, target=target):
            return [x[1], (KP * (target - x[0]) - servo.damping * x[1] - weight * np.sin(x[0])) / inertia]

        state = solve_ivp(rate, (0, 0.01), state, rtol=1e-9, atol=1e-11).y[:, -1]
        wanted.append(state[0])
    error = simulate(servo, T, u) - wanted
    assert np.abs(error).max() < 1e-5  # rad; the encoder's noise is fifty times that


def test_a_delay_shifts_the_whole_answer():
    u = held(0.5)
    assert np.array_equal(simulate(Servo(delay=0.01), T, u)[1:], simulate(Servo(), T, u)[:-1])


@pytest.mark.parametrize("motion", MOTIONS)
def test_every_motion_starts_at_rest_and_stays_small(motion):
    u = command(motion, np.arange(800) * 0.01, np.random.default_rng(3))
    assert u[0] == 0 and 0.2 < np.abs(u).max() < 1.0


def test_a_drawn_servo_hides_what_its_case_says_and_stays_within_its_spread():
    drawn = [draw("delay", np.random.default_rng(seed)) for seed in range(200)]
    assert {(s.delay, s.payload) for s in drawn} == {(0.010, 0.0)}
    for name, factor in SPREAD.items():
        ratios = np.array([getattr(s, name) for s in drawn]) / getattr(CASES["delay"], name)
        assert 1 / factor <= ratios.min() < 0.8 and 1.2 < ratios.max() <= factor


def test_a_guess_hides_nothing_and_stays_within_a_factor_of_two():
    given = guess(CASES["payload"], np.random.default_rng(1))
    assert (given.delay, given.payload) == (0.0, 0.0)
    ratios = [getattr(given, n) / getattr(CASES["payload"], n) for n in TUNED]
    assert all(0.5 <= r <= 2.0 for r in ratios) and len(set(ratios)) == 3


def test_the_files_of_a_case_hold_no_answer_and_come_again_from_the_seed(tmp_path):
    write_case("delay", 3, tmp_path / "a")
    write_case("delay", 3, tmp_path / "b")
    write_case("nothing", 3, tmp_path / "c")
    names = sorted(p.relative_to(tmp_path / "a") for p in (tmp_path / "a").rglob("*.*"))
    assert all((tmp_path / "a" / n).read_bytes() == (tmp_path / "b" / n).read_bytes() for n in names)
    assert names == sorted(p.relative_to(tmp_path / "c") for p in (tmp_path / "c").rglob("*.*"))
    text = (tmp_path / "a" / "robot.toml").read_text() + (tmp_path / "a" / "servo.xml").read_text()
    assert not any(word in text for word in ("delay", "nsample", "0.15"))
    assert [log.name for log in read_runs(tmp_path / "a" / "runs")] == sorted(MOTIONS)


def test_the_project_reads_a_case(tmp_path):
    """`gap` takes its robot file, its runs and the models written from values; the true ones leave the least."""
    from benchmarks.head_to_head.ours import judge

    servo, _ = write_case("delay", 0, tmp_path)
    truth = {n: getattr(servo, n) for n in TUNED}
    diagnosis = write_model({"armature": 0.05}, tmp_path / "diagnosis.json")
    judged = judge(tmp_path, {"true": truth | {"delay": 0.01}, "blind": truth}, diagnosis)
    assert judged.gaps["true"] < 2 * judged.noise_floor < 0.3 * judged.gaps["blind"]
    assert {"guess", "diagnosed"} < set(judged.gaps)


def test_a_document_is_understood_by_our_names():
    document = {
        "verdict": "effects",
        "model": {"values": [{"effect": "tune", "target": None, "parameter": "joint.shoulder.damping", "value": 0.7}]},
        "explanation": [
            {"effect": "payload", "target": None, "probability": 0.9,
             "parameters": {"mass": {"value": 0.14, "ci95": [0.1, 0.2], "unit": "kg"}}},
            {"effect": "backlash", "target": "shoulder", "probability": 0.6, "parameters": {}},
        ],
        "confounded": [[{"effect": "payload", "target": None}, [{"effect": "a"}, {"effect": "b"}]]],
    }  # fmt: skip
    said = understand(document, Servo(0.02, 0.5, 0.1), 3.0)
    assert said.values == {"armature": 0.02, "damping": 0.7, "friction": 0.1, "payload": 0.14}
    assert said.intervals == {"payload": (0.1, 0.2)} and said.beside == ["backlash"]
    assert said.groups == [["payload", "a + b"]]
    assert page.claim(said) == "`payload` with `backlash`"


def match(case: str, seed: int, *, friction: float, named: float | None, interval=(0.0, 1.0)) -> Match:
    """A made-up match: the toolbox's friction over the true one, and the diagnosed hidden parameter."""
    truth = {n: getattr(CASES[case], n) for n in TUNED}
    widths = dict.fromkeys(TUNED, 0.01)
    blind = Fit(truth | {"friction": friction * truth["friction"]}, widths, "No Issues Detected", 2.0)
    fits = {"nothing": blind}
    hidden = {case: getattr(CASES[case], case)} if case in HIDDEN else {}
    fits["sensor" if case not in HIDDEN else case] = Fit(truth | hidden, widths | dict.fromkeys(hidden, 0.001), "", 2.0)
    said = truth if named is None else truth | {case if case in HIDDEN else "delay": named}
    intervals = {} if named is None else {case if case in HIDDEN else "delay": interval}
    verdict = "no_gap" if named is None else "effects"
    gaps = dict.fromkeys(("guess", "true", "told_nothing", f"told_{case}", "diagnosed"), 0.01)
    diagnosed = Diagnosed(verdict, said, intervals, dict.fromkeys(intervals, 0.9), [], [], 30.0)
    return Match(case, seed, CASES[case], CASES[case], fits, diagnosed, Judged(gaps, 0.001), "")


def test_a_match_survives_its_file(tmp_path):
    made = match("delay", 4, friction=3.2, named=0.0101, interval=(0.0099, 0.0103))
    (tmp_path / "match.json").write_text(json.dumps(asdict(made)))
    assert read(tmp_path / "match.json") == made


def test_the_page_says_what_was_measured_and_what_speaks_against_the_diagnosis():
    matches = [
        match("nothing", 0, friction=1.0, named=None),
        match("delay", 0, friction=3.2, named=0.0101, interval=(0.0099, 0.0103)),
        match("payload", 0, friction=1.0, named=None),  # missed
        match("step", 0, friction=1.0, named=0.001),  # a false alarm
    ]
    text = page.write_page(matches)
    assert "returns 3.20 times the true dry friction, 11 half-widths" in text
    assert "names exactly what is hidden in 1 of 2" in text
    assert "With 0.15 kg of payload, seed 0, it answers `no_gap`" in text
    assert "to a user 1 of 1 are false alarms" in text
    assert "| 0.15 kg of payload | `diagnose`, told nothing | never named" in text


def test_the_toolboxs_delay_is_judged_as_a_dead_time():
    assert alone({"delay": 0.011, "friction": 0.05}) == {"delay": pytest.approx(0.010), "friction": 0.05}


def test_an_interval_beside_the_truth_is_counted_against_whoever_stated_it():
    m = match("delay", 0, friction=1.0, named=0.0104, interval=(0.0103, 0.0105))
    assert not page.holds(m, "delay") and page.fit_holds(m.fits["delay"], m, "delay")
    boundless = replace(m.fits["delay"], half_widths=m.fits["delay"].half_widths | {"delay": np.inf})
    assert not page.fit_holds(boundless, m, "delay")
    off = replace(m.fits["delay"], values=m.fits["delay"].values | {"delay": 0.0115})
    assert not page.fit_holds(off, m, "delay")


def test_spread_and_count_are_short_where_nothing_differs():
    assert page.spread([1.0, 1.001], "{:.2f}") == "1.00"
    assert page.spread([1.0, 3.0, 2.0], "{:.0f}") == "2 (1 to 3)"
    assert page.count(["a", "a"]) == "a" and page.count(["b", "a", "a"]) == "a (2x), b (1x)"


def test_a_toolbox_without_its_extra_is_refused_with_the_install_command(monkeypatch):
    monkeypatch.setattr(toolbox, "import_module", lambda name: ModuleType(name))
    with pytest.raises(ModuleNotFoundError, match=r"pip install 'residual-mpc\[sysid\]'"):
        toolbox.fit(None, Servo(), None)  # type: ignore[arg-type]


@pytest.mark.slow
def test_the_toolbox_is_right_where_nothing_is_hidden(tmp_path):
    """What shows that it is driven as its manual says: only then do its errors elsewhere mean anything."""
    pytest.importorskip("tabulate", reason="the toolbox wants pip install 'residual-mpc[sysid]'")
    truth, given = write_case("nothing", 0, tmp_path)
    found = toolbox.fit(tmp_path, given, None)
    for name in TUNED:
        assert found.values[name] == pytest.approx(getattr(truth, name), rel=0.05)
    assert found.says == "No Issues Detected"
