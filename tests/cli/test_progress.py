"""What a waiting user sees, and what a reader finds while files are written."""

import time
from pathlib import Path

import pytest

from residual_mpc.cli.progress import progress_bar
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
