"""The robot's motion in pictures: where it is drawn, how the motions are told apart, and what is shown of a window."""

import io
import shutil
from dataclasses import replace

import numpy as np
import pytest
from fabricated_diagnosis import document
from filmed import filmed
from oracles.arms import arm_xml, robot_of
from oracles.rover_log import rover_run
from PIL import Image

from plants.diff_drive import DiffDrive
from plants.mujoco_robot.drawing import renderer
from residual_mpc.errors import BadInput
from residual_mpc.logs.run import Run
from residual_mpc.models.drawing import NoRenderer
from residual_mpc.models.settings import Knob
from residual_mpc.report import Evidence, compose
from residual_mpc.report.evidence.evidence import Clip
from residual_mpc.report.motion.animation import moving, still, write_video
from residual_mpc.report.motion.choose import CORRECTION, GAP, TYPICAL, chosen_windows
from residual_mpc.report.motion.film import film
from residual_mpc.report.motion.ghosts import FRAMES, ghosts
from residual_mpc.report.motion.ink import CORRECTED, MEASURED, PAPER, PREDICTED
from residual_mpc.report.motion.overlay import overlay
from residual_mpc.report.motion.top_view import shapes, tile_of, top_view

ROVER = DiffDrive("rover", 0.033, 0.16)
TRACK = {Knob("track_width", None, "scale"): 1.6}
SIZE = (200, 150)


@pytest.fixture(scope="module")
def made():
    return filmed(rover_run("wide", {"track_width": {"scale": 1.6}}, 8.0, seed=3), ROVER, TRACK)


@pytest.fixture(scope="module")
def clips(made):
    found, how = film(made)
    assert how == "Seen from above."
    return found


def near(frame, colour, within=60):
    """(height, width) bool: where a frame has about this colour."""
    return np.abs(frame.astype(int) - np.array(colour)).sum(axis=-1) < within


def test_the_windows_are_held_out_and_are_the_worst_and_the_most_corrected(made):
    chosen = chosen_windows(made)
    assert len(chosen) == 2
    assert {label for labels in chosen.values() for label in labels} - {TYPICAL} == {GAP, CORRECTION}
    assert all(made.held[w] for w in chosen)


def test_the_motions_begin_at_one_place_and_the_corrected_one_stays_with_the_measured(made):
    window = next(iter(chosen_windows(made)))
    motions = ghosts(made, window)
    x, y = (np.stack([m[c] for m in motions.motions]) for c in ("pose.x", "pose.y"))
    apart = np.hypot(x - x[0], y - y[0])
    assert motions.assumed == () and apart.shape == (3, FRAMES)
    assert apart[:, 0].max() < 0.01 and apart[2, -1] < 0.25 * apart[1, -1]


def test_a_robot_that_drives_is_shown_over_its_longest_horizon_first():
    made = filmed(rover_run("wide", {"track_width": {"scale": 1.6}}, 8.0, seed=3), ROVER, TRACK, (1.0, 4.0))
    (first, *others), _ = film(made)
    assert first.seconds == pytest.approx(4.0, abs=0.1) and len(first.frames) > FRAMES
    assert first.shows == ("4 s from one start (not held out)",)
    assert [clip.seconds for clip in others] == [pytest.approx(1.0, abs=0.1)] * len(others) and len(others) == 2
    assert first.before > 0.3 > 10 * first.after  # of the motion over 4 s, not over 1 s
    assert len(film(filmed(rover_run("wide", {}, 8.0, seed=3), ROVER, {}, (1.0,)))[0]) == 2


def test_an_outline_is_drawn_where_the_robot_is():
    motion = {"pose.x": np.array([0.0, 1.0]), "pose.y": np.array([0.0, 0.5]), "pose.theta": np.array([0.0, np.pi / 2])}
    square = 0.1 * np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
    view = top_view((motion,), square, SIZE)
    drawn = shapes((motion,), square, view)
    assert drawn.shape == (1, 2, 150, 200)
    for k in (0, 1):
        rows, columns = np.nonzero(drawn[0, k] > 100)
        place = view.place(np.array([motion["pose.x"][k], motion["pose.y"][k]]))
        np.testing.assert_allclose([columns.mean(), rows.mean()], place - 0.5, atol=0.6)
        assert np.ptp(columns) + 1 == pytest.approx(0.2 * view.scale, abs=2.0)


def test_a_prediction_that_runs_away_leaves_the_view():
    own = {"pose.x": np.linspace(0, 1, 5), "pose.y": np.zeros(5), "pose.theta": np.zeros(5)}
    far = {**own, "pose.x": np.array([0.0, 1.0, 1e3, 1e9, np.inf])}
    view = top_view((own, far), None, SIZE)
    assert view.scale > 0.02 * min(SIZE)
    assert shapes((own, far), None, view).shape[1] == 5


@pytest.mark.parametrize(("extent", "tile"), [(1.0, 0.2), (0.3, 0.05), (52.0, 10.0), (24.9, 2.0)])
def test_grid_tiles_are_round(extent, tile):
    assert tile_of(extent) == pytest.approx(tile)


def test_each_motion_is_in_the_picture_at_its_place_in_its_ink():
    inks, places = (MEASURED, PREDICTED, CORRECTED), np.array([[30.0, 40.0], [70.0, 40.0], [70.0, 80.0]])
    shades = np.zeros((3, 1, 100, 120), dtype=np.uint8)
    for k, (x, y) in enumerate(places.astype(int)):
        shades[k, 0, y - 15 : y + 15, x - 15 : x + 15] = 255
    (frame,) = overlay(Image.new("RGB", (120, 100), PAPER), shades, places[:, None], 0.0, inks)
    for (x, y), ink in zip(places.astype(int), inks, strict=True):
        assert near(frame[y : y + 1, x], ink.colour).all()
    dark, orange, blue = (frame[y - 10, x - 10].astype(int) for x, y in places.astype(int))
    assert dark.sum() < orange.sum() - 150 and orange[0] > orange[2] + 30 and blue[2] > blue[0] + 30
    edge = near(frame[40 - 15, 70 - 15 : 70 + 15], PREDICTED.colour)
    assert 0.2 < edge.mean() < 0.8  # dashed
    assert near(frame[80 - 15, 70 - 15 : 70 + 15], CORRECTED.colour).all()


def test_the_animation_has_every_frame_and_fits_into_a_page(clips):
    for clip in clips:
        shown = Image.open(io.BytesIO(moving(clip)))
        assert shown.n_frames == len(clip.frames) == FRAMES and shown.info["loop"] == 0
        assert Image.open(io.BytesIO(still(clip))).size == shown.size
    page = compose(document("effects"), Evidence(clips=clips, drawing="Seen from above."))
    assert len(page.encode()) < 1_000_000 and page.count('class="paper moving"') == len(clips)
    assert "prefers-reduced-motion" in page


@pytest.mark.parametrize("suffix", [".webp", ".gif"])
def test_a_video_shows_all_clips(tmp_path, clips, suffix):
    path = tmp_path / f"motion{suffix}"
    write_video(clips, path)
    assert Image.open(path).n_frames == sum(len(c.frames) for c in clips)


def test_a_video_of_another_kind_is_refused(tmp_path, clips):
    with pytest.raises(BadInput, match=r"\.mp4, \.gif, \.webp"):
        write_video(clips, tmp_path / "motion.avi")


def test_an_mp4_without_ffmpeg_is_refused(tmp_path, clips, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(BadInput, match="ffmpeg"):
        write_video(clips, tmp_path / "motion.mp4")


def test_a_model_without_named_effects_is_drawn_without_a_corrected_motion():
    clips, _ = film(filmed(rover_run("plain", {}, 4.0, seed=5), ROVER, {}))
    assert [clip.shows for clip in clips] == [(GAP,), (TYPICAL,)]
    assert clips[0].before >= clips[1].before and clips[0].after is None
    assert not near(clips[0].frames[-1], CORRECTED.colour, 30).any()


def test_a_joint_that_nobody_measured_moves_as_predicted_and_the_report_says_so(tmp_path, monkeypatch):
    def none():
        raise NoRenderer("no renderer was found (tried egl and osmesa)")

    monkeypatch.setattr(renderer, "_backend", none)
    arm = robot_of(tmp_path, arm_xml())
    t = np.arange(0.0, 4.0, 0.02)
    u = 0.5 * np.sin(2.0 * t)
    run = Run("one", t, {"command.j1": 2.0 * u, "command.j2": u, "position.j1": 0.8 * u})
    made = filmed(run, arm, {})
    motions = ghosts(made, 2)
    assert motions.assumed == ("position.j2",)
    np.testing.assert_array_equal(motions.measured["position.j2"], motions.predicted["position.j2"])
    assert np.ptp(motions.predicted["position.j2"]) > 0.05
    clips, how = film(made)
    page = compose(document("effects"), Evidence(clips=clips, drawing=how))
    assert "Drawn as a skeleton: no renderer was found (tried egl and osmesa)." in page
    assert "Not measured, and drawn as predicted: position.j2." in page


def test_a_robot_of_which_no_position_was_logged_is_not_drawn():
    whole = rover_run("one", {}, 4.0, seed=5)
    blind = replace(whole, columns={k: v for k, v in whole.columns.items() if not k.startswith("pose")}
                    | {"twist.theta": np.gradient(whole.columns["pose.theta"], whole.t)})  # fmt: skip
    clips, how = film(filmed(blind, ROVER, {}))
    assert clips == () and how.startswith("No position of the robot was logged")


@pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="needs ffmpeg")
def test_an_mp4_is_written(tmp_path, clips):
    write_video(clips, tmp_path / "motion.mp4")
    assert (tmp_path / "motion.mp4").read_bytes()[4:8] == b"ftyp"


def test_a_drawing_that_fails_leaves_the_report(made, monkeypatch):
    monkeypatch.setattr(DiffDrive, "outline", property(lambda self: 1 / 0))
    clips, how = film(made)
    assert clips == () and "ZeroDivisionError" in how
    assert how.split("(")[0] in compose(document("effects"), Evidence(drawing=how))


def test_frames_must_be_pictures():
    with pytest.raises(ValueError, match="frames"):
        Clip((GAP,), "run", 0.0, 0.1, None, np.zeros((3, 4, 5), dtype=np.uint8), 0, 1.0)
