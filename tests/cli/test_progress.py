"""What a waiting user sees, and what a reader finds while files are written."""

import time
from pathlib import Path

import pytest

from residual_mpc.cli.progress import Pace, StatusLine, progress_bar, time_left, words_left
from residual_mpc.errors import BadInput
from residual_mpc.files import write_atomically


def test_a_long_stage_is_not_silent(capsys: pytest.CaptureFixture[str]) -> None:
    with progress_bar(quiet=0.02) as progress:
        progress("fitting", 0.5)
        time.sleep(0.2)
        progress("reporting", 0.9)
    said = capsys.readouterr().err.splitlines()
    assert said[0] == "[ 50%] fitting" and said[-1].startswith("[ 90%] reporting")
    assert any(line.startswith("[ 50%] fitting (") for line in said)


@pytest.mark.parametrize(
    ("now", "began", "done", "left"),
    [
        (10.0, 10.0, 0.2, 40.0),
        (30.0, 10.0, 0.2, 20.0),
        (90.0, 10.0, 0.2, 12.0),
        (2.0, 2.0, 0.5, None),
        (9.0, 9.0, 1.0, None),
    ],
)
def test_the_time_left_is_told_once_it_can_be(now: float, began: float, done: float, left: float | None) -> None:
    """It goes down while a stage lasts, but not to nothing."""
    assert time_left(now, began, done) == (None if left is None else pytest.approx(left))


@pytest.mark.parametrize(
    ("left", "words"),
    [
        (None, ""),
        (1.0, "about 5 s left"),
        (42.0, "about 40 s left"),
        (200.0, "about 3 min left"),
        (9000.0, "about 2 h left"),
    ],
)
def test_the_time_left_in_words(left: float | None, words: str) -> None:
    assert words_left(left) == words


def test_a_resumed_call_tells_no_time_left(monkeypatch: pytest.MonkeyPatch) -> None:
    """It reaches in a moment what took minutes."""
    clock = iter((0.0, 1.0, 60.0, 60.0))
    monkeypatch.setattr("residual_mpc.cli.progress.monotonic", lambda: next(clock))
    resumed = Pace(timed=True)
    resumed.reach(0.6)
    resumed.reach(0.7)
    assert resumed.words() == ""


def test_only_shares_of_the_time_tell_the_time_left(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = [0.0]
    monkeypatch.setattr("residual_mpc.cli.progress.monotonic", lambda: clock[0])
    paces = [Pace(timed) for timed in (True, False)]
    clock[0] = 10.0
    for pace in paces:
        pace.reach(0.2)
    assert [pace.words() for pace in paces] == ["about 40 s left", ""]


def test_a_search_that_begins_again_takes_back_no_share(monkeypatch: pytest.MonkeyPatch) -> None:
    """The time left would go from minutes to hours."""
    clock = [0.0]
    monkeypatch.setattr("residual_mpc.cli.progress.monotonic", lambda: clock[0])
    pace = Pace(timed=True)
    for now, share in ((10.0, 0.05), (60.0, 0.3), (70.0, 0.08)):
        clock[0] = now
        reached = pace.reach(share)
    assert reached == 0.3
    assert pace.words() == words_left(60.0 * 0.7 / 0.3 - 10.0) == "about 2 min left"


def test_the_lines_of_a_search_that_begins_again_show_no_smaller_share(capsys: pytest.CaptureFixture[str]) -> None:
    with progress_bar() as progress:
        for stage, done in (("searching", 0.3), ("searching, from the beginning", 0.1)):
            progress(stage, done)
    assert capsys.readouterr().err == "[ 30%] searching\n[ 30%] searching, from the beginning\n"


def test_a_stage_is_said_once(capsys: pytest.CaptureFixture[str]) -> None:
    with progress_bar() as progress:
        for done in (0.1, 0.2, 0.3):
            progress("fitting", done)
    assert capsys.readouterr().err == "[ 10%] fitting\n"


def test_a_file_is_replaced_whole(tmp_path: Path) -> None:
    path = tmp_path / "new" / "a.json"
    write_atomically(path, "one")
    write_atomically(path, "two")
    assert path.read_text() == "two" and list(path.parent.iterdir()) == [path]


def test_a_failed_write_keeps_the_old_file_and_leaves_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    write_atomically(path, "old")
    with pytest.raises(UnicodeEncodeError):
        write_atomically(path, "half\ud800")
    assert path.read_text() == "old" and list(tmp_path.iterdir()) == [path]


def test_a_folder_that_cannot_be_made_is_a_users_fault(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(BadInput, match="cannot be written"):
        write_atomically(tmp_path / "file" / "a.txt", "x")


def test_a_status_line_is_rewritten_and_erased(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    monkeypatch.setenv("COLUMNS", "24")
    status = StatusLine()
    status("searching for causes, a long stage", 0.8)
    status("refining", 0.9)
    status.erase()
    status.erase()
    second = "[ 90%] refining"
    assert capsys.readouterr().err == f"\r[ 80%] searching for ca\r{second.ljust(23)}\r{' ' * len(second)}\r"


def test_a_status_line_says_nothing_in_a_file(capsys: pytest.CaptureFixture[str]) -> None:
    status = StatusLine()
    status("searching", 0.8)
    status.erase()
    assert capsys.readouterr().err == ""
