"""The pages of a learned residual and of a closed-loop run: complete, self-contained, and true to their documents."""

import re
from dataclasses import replace

import numpy as np
import pytest
from test_report import Page

from plants.diff_drive import DiffDrive
from residual_mpc.report.drive import Driven, better, drive_page, drive_sentence
from residual_mpc.report.figures.controllers import LINES
from residual_mpc.report.learned import helps, learned_page, learned_sentence
from residual_mpc.report.motion.drive_film import FRAMES, film_drive
from residual_mpc.report.words.learned import learned_lines

LEARNED = {
    "case": "real-to-dyn", "updates": 90, "parameters": 203, "form": "body", "step": 0.05, "seconds": 120.0,
    "h2_norm": {"first": 0.3, "last": 0.05, "held_out_before": 0.31, "held_out_after": 0.06},
    "converged_after": 40.0, "update_ms": {"median": 0.9, "p99": 1.4},
    "gap": {"before": 0.2, "after": 0.05, "on": "held_out", "without_spikes": None,
            "channels": {"pose.x": {"before": 0.1, "after": 0.04}, "pose.theta": {"before": 0.3, "after": 0.06}}},
    "held_out": ["run <3>", {"run": "run1", "from": 2.0, "to": 5.0}],
    "inputs": ["command.left"], "outputs": ["body.yaw"],
    "chosen_pass": 2, "left_alone": [], "worse_on_held_out": ["body.forward"], "condition": None,
    "history": [[1.0, 0.3], [50.0, 0.1], [120.0, 0.05]], "note": "A memoryless network cannot learn dead time.",
}  # fmt: skip


def controller(error, **more):
    errors = {"tracking_rmse": error, "tracking_max": 0.02, "h2_norm": 0.1}
    return {**errors, "solve_ms": {"median": 0.3, "p99": 0.9}, "failures": 1, "late": 2, **more}


RUN = {
    "scenario": "eight <2>", "plant": "mujoco", "seeds": 2, "controller": "mpc", "unit": "m", "robot": "rover",
    "controllers": {"nominal": controller(0.013), "augmented": controller(0.001), "oracle": controller(0.0009),
                    "online": controller(0.002, h2_norm={"first": 0.3, "last": 0.1})},
    "recovered": {"augmented": {"value": 0.99, "ci95": [0.97, 1.0]}, "online": None},
}  # fmt: skip


def driven(name, channels=("pose.x", "pose.y", "pose.theta")):
    t = np.linspace(0.0, 12.0, 121)
    wanted = np.stack([np.sin(t + k) for k in range(len(channels))], axis=1)
    off = 0.01 if name == "nominal" else 0.001
    return Driven(name, channels, t, wanted, wanted + off, np.full(len(t), off))


def pages():
    some = [driven("nominal"), driven("augmented")]
    joints = [driven(n, ("position.j1", "position.j2")) for n in ("nominal", "oracle")]
    return {
        "learned": learned_page(LEARNED, "rover <1>"),
        "useless": learned_page({**LEARNED, "gap": {**LEARNED["gap"], "after": 0.2}, "history": []}, "rover"),
        "drive": drive_page(RUN, some, None),
        "joints": drive_page({**RUN, "unit": "rad", "controllers": {"nominal": controller(None)}}, joints, None),
    }


@pytest.fixture(scope="module", params=["learned", "useless", "drive", "joints"])
def page(request):
    return Page(pages()[request.param])


def test_pages_are_whole_and_need_nothing_else(page):
    ids = [attributes["id"] for _, attributes in page.elements if attributes.get("id")]
    assert len(ids) == len(set(ids)) and len(page.all("h1")) == 1
    assert all(a["href"].removeprefix("#") in ids for a in page.all("a"))
    assert not page.all("script") and not page.all("link") and not page.all("iframe")
    assert any("default-src 'none'" in str(meta.get("content")) for meta in page.all("meta"))
    assert len(page.all("caption")) == len(page.all("table"))
    assert not re.search(r"\b(None|nan|undefined|inf)\b", page.text)


def test_a_network_that_helps_says_by_how_much():
    assert helps(LEARNED)
    assert learned_sentence(LEARNED).replace("\N{NO-BREAK SPACE}", " ") == (
        "A network with 203 weights, trained on 120 s of data, removes 75 % of the gap on held-out data."
    )
    text = Page(pages()["learned"]).text
    assert "worse on held-out data: body.forward" in text and "run <3>" in text and "rover <1>" in text


def test_a_network_that_does_not_help_is_not_recommended():
    same = {**LEARNED, "gap": {**LEARNED["gap"], "after": 0.2}}
    assert not helps(same) and "better without it" in learned_sentence(same)


def test_a_network_of_which_nothing_was_kept():
    gap = {**LEARNED["gap"], "after": 0.2, "noise_floor": 0.05, "at_noise_floor": {"before": False, "after": False}}
    none = {**LEARNED, "gap": gap, "kept": False, "chosen_pass": 0}
    assert learned_sentence(none).startswith("Nothing that was learned was kept: no pass over the data")
    assert "the model predicts held-out runs better" in learned_sentence({**none, "chosen_pass": 1})


def test_the_gap_of_a_network_stands_beside_the_noise_floor():
    channels = {c: {**g, "noise_floor": 0.0351} for c, g in LEARNED["gap"]["channels"].items()}
    gap = {**LEARNED["gap"], "before": 0.042, "after": 0.0403, "noise_floor": 0.0357, "channels": channels}
    for before, after, said in (
        (True, True, "was at the noise floor without the network: nothing is left to learn"),
        (False, True, "With the network the gap is at the noise floor: nothing more is left to learn"),
        (False, False, ""),
    ):
        document = {**LEARNED, "gap": {**gap, "at_noise_floor": {"before": before, "after": after}}}
        text = Page(learned_page(document, "rover")).text.replace("\N{NO-BREAK SPACE}", " ")
        assert "noise floor: 3.6 %" in text and "0.0357 (noise floor)" in text and "0.0351" in text
        assert said in text and ("left to learn" in text) == bool(said)


@pytest.mark.parametrize(
    ("holds", "kept", "said"),
    [(True, True, "is kept"), (True, False, "is set to zero, since the gap is larger with it"),
     (False, False, "is set to zero")],
)  # fmt: skip
def test_what_became_of_the_earlier_residual_is_said_in_words(holds, kept, said):
    condition = {"without": 0.18, "with_earlier": 0.149, "holds": holds, "kept": kept}
    gap = {**LEARNED["gap"], "noise_floor": 0.01, "at_noise_floor": {"before": False, "after": False}}
    document = {**LEARNED, "gap": gap, "kept": True, "turned_over": [], "nothing_earlier": False,
                "condition": condition}  # fmt: skip
    words = f"{said}: the measured and the predicted velocities differ by 0.149 on average with it, by 0.18 without it"
    assert f"the earlier residual {words}" in "\n".join(learned_lines(document))
    assert f"The residual of the previous case {words}" in Page(learned_page(document, "rover")).text


def test_a_norm_that_hardly_falls_has_not_converged():
    gap = {**LEARNED["gap"], "noise_floor": 0.01, "at_noise_floor": {"before": False, "after": False}}
    document = {**LEARNED, "gap": gap, "kept": True, "turned_over": [], "nothing_earlier": False}
    assert "converged after 40 s" in "\n".join(learned_lines(document))
    flat = {**document, "h2_norm": {**LEARNED["h2_norm"], "first": 0.0352, "last": 0.0348}, "converged_after": 0.76}
    assert "the H2 norm decreased by less than 10%" in "\n".join(learned_lines(flat))
    assert "The norm fell by less than 10 %" in Page(learned_page(flat, "rover")).text


def test_the_course_is_drawn_only_where_it_was_kept():
    assert 'id="course"' in pages()["learned"] and 'id="course"' not in pages()["useless"]


@pytest.mark.parametrize(
    ("nominal", "augmented", "said", "helps_"),
    [(0.013, 0.001, "1 mm off its reference (RMS), 92 % less than the 13 mm with the nominal model", True),
     (0.010, 0.012, "12 mm off its reference (RMS), 20 % more than the 10 mm", False),
     (0.010, 0.0101, "follows the path equally well with both models", False),
     (None, 0.001, "With the nominal model the MPC lost the path", True),
     (0.010, None, "With the corrected model the MPC lost the path", False)],
)  # fmt: skip
def test_a_drive_in_a_sentence(nominal, augmented, said, helps_):
    run = {**RUN, "controllers": {"nominal": controller(nominal), "augmented": controller(augmented)}}
    assert said in drive_sentence(run).replace("\N{NO-BREAK SPACE}", " ")
    assert better(run) is helps_


def test_a_drive_shows_every_controller_and_what_was_recovered():
    text = Page(pages()["drive"]).text.replace("\N{NO-BREAK SPACE}", " ")
    for words in ("nominal model", "corrected model", "true model", "network that learns while driving"):
        assert words in text
    assert "recovers 99 %" in text and "0.3 → 0.1" in text and "rover: eight <2>" in text


def test_the_lines_of_all_controllers_differ_without_colour_as_well():
    lines = [(line.width, line.dashes) for line in LINES.values()]
    assert len(set(lines)) == len(lines) == len({line.colour for line in LINES.values()})
    page = drive_page(RUN, [driven(n) for n in LINES], None)
    for line in LINES.values():
        assert f"stroke:var(--{line.colour});stroke-width:{line.width:g}" in page  # in the legend
        assert page.count(f"var(--{line.colour})") > 2  # and in the figures
    assert "The named effects alone and the network alone drove exactly the same paths" in Page(page).text


@pytest.mark.parametrize(
    ("online", "said"),
    [(0.0131, "Learning while driving did not help: 13.1 mm against 13 mm with the nominal model."),
     (0.02, "Learning while driving did harm: 20 mm against 13 mm"), (None, "Learning while driving lost the path"),
     (0.002, "")],
)  # fmt: skip
def test_a_network_without_use_is_named(online, said):
    run = {**RUN, "controllers": {**RUN["controllers"], "online": controller(online)}}
    text = Page(drive_page(run, [], None)).text.replace("\N{NO-BREAK SPACE}", " ")
    assert said in text and ("Learning while driving" in text) == bool(said)


@pytest.mark.parametrize(("share", "said"), [(1.02, True), (0.99, False)])
def test_more_than_all_recovered_is_explained(share, said):
    run = {**RUN, "recovered": {"augmented": {"value": share, "ci95": [share - 0.01, share + 0.01]}}}
    text = Page(drive_page(run, [], None)).text
    assert ("More than 100 % is possible" in text) == said and "It is not an upper bound" in text


def test_the_film_of_a_drive_has_the_reference_and_both_robots():
    robot, t = DiffDrive("rover", 0.033, 0.16), np.linspace(0.0, 10.0, 101)
    path = {"pose.x": 0.1 * t, "pose.y": np.sin(0.5 * t), "pose.theta": np.arctan(5 * np.cos(0.5 * t))}
    clip = film_drive(robot, t, path, {**path, "pose.x": 0.12 * t}, path)
    assert clip is not None and clip.frames.shape[0] == FRAMES and clip.seconds == 10.0
    assert clip.still == FRAMES - 1  # the nominal robot is farthest away at the end
    shown = drive_page(RUN, [driven("nominal")], replace(clip, frames=clip.frames[:3], still=2))
    assert [image["alt"] for image in Page(shown).all("img")] == [
        "The robot driven with the nominal and with the corrected model, over its reference."
    ] * 2


def test_a_reference_that_leaves_the_robot_open_is_not_filmed():
    t = np.linspace(0.0, 1.0, 11)
    tool = {"tool.x": t}
    assert film_drive(DiffDrive("rover", 0.033, 0.16), t, tool, tool, tool) is None
