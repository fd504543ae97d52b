"""Logs as they arrive: half a line waits, a command that is logged when it changes is held, pauses end a segment."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import residual_mpc as rm
from residual_mpc.errors import BadInput
from residual_mpc.monitoring.arrivals.follow import Arrival, Tail, follow_files
from residual_mpc.monitoring.arrivals.rows import RowReader, Rows
from residual_mpc.monitoring.arrivals.segments import Stream
from residual_mpc.monitoring.monitor import _left_out
from residual_mpc.monitoring.settings import ArrivalSettings

SETTINGS = ArrivalSettings()
HEADER = "t,command.left,command.right,pose.x,pose.y,pose.theta"
ROBOT = 'name = "rover"\nplant = "diff_drive"\n[parameters]\nwheel_radius = 0.05\ntrack_width = 0.3\n'


@pytest.fixture
def reader(tmp_path: Path) -> RowReader:
    (tmp_path / "robot.toml").write_text(ROBOT)
    return RowReader(rm.load_robot(tmp_path / "robot.toml").file, ("left", "right"), SETTINGS)


def line(t: float, command: str = "1.0", x: float = 0.0) -> str:
    return f"{t:.2f},{command},{command},{x:.3f},0.0,0.0"


def rows_at(stamps: np.ndarray) -> Rows:
    columns = {"command.left": np.ones(len(stamps)), "pose.x": stamps.copy()}
    return Rows("run", stamps, columns, frozenset(), "run.csv")


def test_half_a_line_waits_for_its_rest() -> None:
    tail = Tail("run", "run.csv")
    text = "\n".join([HEADER, line(0.0), line(0.1, x=0.123)]) + "\n"
    cut = len(text) - 9  # in the middle of x = 0.123
    first = list(tail.add(text[:cut].encode()))
    second = list(tail.add(text[cut:].encode()))
    assert [a.lines for a in first] == [(line(0.0),)]
    assert [a.lines for a in second] == [(line(0.1, x=0.123),)]


def test_every_cut_of_the_text_gives_the_same_lines() -> None:
    text = "\n".join([HEADER, *(line(0.1 * k) for k in range(20))]) + "\n"
    for size in (1, 7, 64, 1000):
        tail = Tail("run", "run.csv")
        pieces = [text[k : k + size].encode() for k in range(0, len(text), size)]
        lines = [ln for piece in pieces for arrival in tail.add(piece) for ln in arrival.lines]
        assert lines == text.splitlines()[1:]


def test_a_command_that_is_logged_when_it_changes_is_held_over_blocks(reader: RowReader) -> None:
    first = Arrival("run", "run.csv", HEADER, (line(0.0, "2.0"), line(0.1, "")), fresh=True)
    second = Arrival("run", "run.csv", HEADER, (line(0.2, ""), line(0.3, "")))
    stream = Stream(SETTINGS)
    for arrival in (first, second):
        for rows in reader.read(arrival):
            list(stream.add(rows))
    (segment,) = stream.segments
    run = segment.run(0.15)
    assert run is not None and run.t == pytest.approx([0.2, 0.3])
    assert run.columns["command.left"][0] == 2.0


def test_rows_are_taken_once(reader: RowReader) -> None:
    lines = tuple(line(0.1 * k, x=0.01 * k) for k in range(30))
    stream = Stream(SETTINGS)
    for k in range(0, 30, 7):
        for rows in reader.read(Arrival("run", "run.csv", HEADER, lines[k : k + 7], fresh=k == 0)):
            list(stream.add(rows))
    run = stream.segments[0].run(0.0)
    assert run is not None
    assert run.t == pytest.approx(0.1 * np.arange(30))
    assert run.columns["pose.x"] == pytest.approx(0.01 * np.arange(30))


def followed(folder: Path, between: Callable[[], None]) -> list[str]:
    """Lines of a folder's logs: what is there, and what is there after something happened."""
    seen, looks = list[str](), 0
    for arrival in follow_files((folder,), False, SETTINGS, lambda seconds: None):
        if arrival is not None:
            seen += arrival.lines
            continue
        looks += 1
        if looks == 2:
            return seen
        between()
    return seen


def test_a_log_that_is_renamed_when_a_new_one_begins_is_read_once(tmp_path: Path) -> None:
    def rotate() -> None:
        (tmp_path / "log.csv").rename(tmp_path / "log-1.csv")
        text = [HEADER, *(line(0.1 * k) for k in range(20, 50))]  # longer than what was read of the first
        (tmp_path / "log.csv").write_text("\n".join(text) + "\n")

    (tmp_path / "log.csv").write_text("\n".join([HEADER, *(line(0.1 * k) for k in range(20))]) + "\n")
    assert followed(tmp_path, rotate) == [line(0.1 * k) for k in range(50)]


def test_a_log_that_is_emptied_and_written_anew_is_read_from_its_beginning(tmp_path: Path) -> None:
    def anew() -> None:
        text = [HEADER, *(line(0.1 * k) for k in range(20, 50))]
        with open(tmp_path / "log.csv", "r+") as file:  # the same file on the disk, and longer than before
            file.truncate(0)
            file.write("\n".join(text) + "\n")

    (tmp_path / "log.csv").write_text("\n".join([HEADER, *(line(0.1 * k) for k in range(20))]) + "\n")
    assert followed(tmp_path, anew) == [line(0.1 * k) for k in range(50)]


@pytest.mark.parametrize("copy", ["log.csv.1", "log-1.csv"])
@pytest.mark.parametrize("mode", ["a", "r+"], ids=["appends", "leaves a hole"])
@pytest.mark.parametrize("headed", [False, True])
def test_a_log_that_is_copied_and_emptied_goes_on(tmp_path: Path, copy: str, mode: str, headed: bool) -> None:
    """As logrotate's copytruncate does: the logger keeps the file open and may write no second header."""
    log = tmp_path / "log.csv"
    log.write_text("\n".join([HEADER, *(line(0.1 * k) for k in range(20))]) + "\n")
    logger = open(log, mode)
    logger.seek(0, 2)

    def rotate() -> None:
        (tmp_path / copy).write_bytes(log.read_bytes())
        os.truncate(log, 0)
        rows = [*([HEADER] if headed else []), *(line(0.1 * k) for k in range(20, 50))]
        logger.write("\n".join(rows) + "\n")
        logger.close()

    assert followed(tmp_path, rotate) == [line(0.1 * k) for k in range(50)]


def test_a_copy_of_a_log_is_read_from_where_the_log_was(tmp_path: Path) -> None:
    """What was written after the last look is in the copy alone."""

    def rotate() -> None:
        every = [HEADER, *(line(0.1 * k) for k in range(30))]
        (tmp_path / "log-1.csv").write_text("\n".join(every) + "\n")
        (tmp_path / "log.csv").write_text("\n".join(line(0.1 * k) for k in range(30, 50)) + "\n")

    (tmp_path / "log.csv").write_text("\n".join([HEADER, *(line(0.1 * k) for k in range(20))]) + "\n")
    assert sorted(followed(tmp_path, rotate), key=lambda row: float(row.split(",")[0])) == [
        line(0.1 * k) for k in range(50)
    ]


def test_another_log_with_the_same_header_and_first_row_is_read_whole(tmp_path: Path) -> None:
    def another() -> None:
        rows = [line(0.0), *(line(0.1 * k + 0.05) for k in range(1, 30))]
        (tmp_path / "other.csv").write_text("\n".join([HEADER, *rows]) + "\n")

    (tmp_path / "log.csv").write_text("\n".join([HEADER, *(line(0.1 * k) for k in range(20))]) + "\n")
    assert len(followed(tmp_path, another)) == 50


def test_a_log_that_a_longer_copy_replaces_goes_on(tmp_path: Path) -> None:
    """As rsync does: the copy is another file on the disk, under the same name."""

    def replaced() -> None:
        (tmp_path / "new.part").write_text("\n".join([HEADER, *(line(0.1 * k) for k in range(50))]) + "\n")
        (tmp_path / "new.part").replace(tmp_path / "log.csv")

    (tmp_path / "log.csv").write_text("\n".join([HEADER, *(line(0.1 * k) for k in range(20))]) + "\n")
    assert followed(tmp_path, replaced) == [line(0.1 * k) for k in range(50)]


@pytest.mark.parametrize("rotated", [False, True])
def test_a_new_binary_log_is_read_where_another_one_lay(tmp_path: Path, rotated: bool) -> None:
    """On the disk, or under the same name."""

    def another() -> None:
        if rotated:
            (tmp_path / "a.parquet").rename(tmp_path / "old.parquet")
            (tmp_path / "a.parquet").write_bytes(b"another log")
        else:
            (tmp_path / "a.parquet").unlink()
            (tmp_path / "b.parquet").write_bytes(b"another log")

    (tmp_path / "a.parquet").write_bytes(b"a log")
    seen, looks = list[str](), 0
    for arrival in follow_files((tmp_path,), False, SETTINGS, lambda seconds: None):
        if arrival is not None:
            seen.append(arrival.name)
            continue
        looks += 1
        if looks == 3:
            another()
        if looks == 6:
            break
    assert seen == (["a", "a"] if rotated else ["a", "b"])


def test_a_log_without_a_command_is_refused_at_once(reader: RowReader) -> None:
    arrival = Arrival("run", "run.csv", "t,pose.x,pose.y", ("0,0,0",), fresh=True)
    with pytest.raises(BadInput, match="command"):
        list(reader.read(arrival))


def test_a_pause_ends_a_segment_and_no_window_spans_it() -> None:
    stream = Stream(SETTINGS)
    stamps = np.concatenate([np.arange(0.0, 5.0, 0.05), np.arange(30.0, 35.0, 0.05)])
    list(stream.add(rows_at(100.0 + stamps)))
    assert [(s.first, s.last) for s in stream.segments] == [
        (pytest.approx(0.0), pytest.approx(4.95)), (pytest.approx(30.0), pytest.approx(34.95)),
    ]  # fmt: skip
    starts = np.concatenate([s.complete(1.0) for s in stream.segments])
    assert starts == pytest.approx([0, 1, 2, 3, 4, 30, 31, 32, 33, 34])


def test_bursts_give_the_same_segments_as_single_rows() -> None:
    stamps = 50.0 + np.arange(0.0, 8.0, 0.05)
    for size in (1, 3, 40):
        stream = Stream(SETTINGS)
        for k in range(0, len(stamps), size):
            list(stream.add(rows_at(stamps[k : k + size])))
        assert len(stream.segments) == 1
        run = stream.segments[0].run(0.0)
        assert run is not None and run.t == pytest.approx(stamps - 50.0)


def test_a_clock_that_is_set_back_begins_a_new_segment() -> None:
    stream = Stream(SETTINGS)
    list(stream.add(rows_at(np.arange(1000.0, 1005.0, 0.05))))
    list(stream.add(rows_at(np.arange(0.0, 5.0, 0.05))))
    assert [s.begun for s in stream.segments] == [1000.0, 0.0]


def test_an_endless_stream_keeps_a_bounded_memory() -> None:
    settings = ArrivalSettings(kept=60.0)
    stream = Stream(settings)
    most = 0
    for k in range(600):
        for segment in stream.add(rows_at(np.arange(k * 1.0, k + 1.0, 0.05))):
            segment.due = segment.last
        stream.forget(2.5)
        most = max(most, sum(len(p) for s in stream.segments for p in s.parts))
    assert most <= 20 * (60 + 10)


def test_a_file_that_appears_later_and_grows_is_followed(tmp_path: Path) -> None:
    naps = iter(range(4))

    def write_more(_: float) -> None:
        k = next(naps)
        if k == 0:
            (tmp_path / "a.csv").write_text("\n".join([HEADER, line(0.0), line(0.1)]) + "\n0.2,1.0")
        elif k == 1:
            with open(tmp_path / "a.csv", "a") as file:
                file.write(",1.0,0.0,0.0,0.0\n")
        else:
            raise KeyboardInterrupt

    seen: list[str] = []
    with pytest.raises(KeyboardInterrupt):
        for arrival in follow_files((tmp_path,), False, SETTINGS, write_more):
            seen += [] if arrival is None else arrival.lines
    assert seen == [line(0.0), line(0.1), "0.2,1.0,1.0,0.0,0.0,0.0"]


@pytest.mark.parametrize("bad", ["0.20,1.0,1.0", "0.20,1.0,oops,0.0,0.0,0.0"])
@pytest.mark.parametrize("early", [True, False])
def test_a_bad_row_is_left_out_and_the_others_are_not(reader: RowReader, bad: str, early: bool) -> None:
    """In the first block of a log as well, as after a restart."""
    lines = [line(0.1 * k) for k in range(SETTINGS.header_rows + 20)]
    if not early:
        list(reader.read(Arrival("run", "run.csv", HEADER, tuple(lines[:-10]), fresh=True)))
        lines = lines[-10:]
    spoilt = (*lines[:3], bad, *lines[3:])
    (rows,) = reader.read(Arrival("run", "run.csv", HEADER, spoilt, fresh=early))
    assert reader.left_out == [bad]
    np.testing.assert_allclose(rows.stamps[-len(lines) :], [float(x.split(",")[0]) for x in lines])


def test_a_log_of_other_actuators_is_refused(reader: RowReader) -> None:
    """It has commands, but none of this robot: no window would ever be judged."""
    header = HEADER.replace("command.left", "command.l").replace("command.right", "command.r")
    with pytest.raises(BadInput, match=r"no column command\.left or command\.right was found"):
        list(reader.read(Arrival("run", "run.csv", header, (line(0.0), line(0.1)), fresh=True)))


def test_a_body_velocity_commands_the_wheels(reader: RowReader) -> None:
    header = HEADER.replace("command.left", "command.linear").replace("command.right", "command.angular")
    (rows,) = reader.read(Arrival("run", "run.csv", header, (line(0.0), line(0.1)), fresh=True))
    assert {"command.left", "command.right"} <= set(rows.columns)


def test_a_block_in_which_nothing_is_like_the_header_is_refused(reader: RowReader) -> None:
    with pytest.raises(BadInput):
        list(reader.read(Arrival("run", "run.csv", HEADER, ("a,b",) * (SETTINGS.header_rows + 5), fresh=True)))


def test_a_quoted_cell_may_hold_the_mark(reader: RowReader) -> None:
    """A row is not bad for that, beside one that is."""
    header, bad = f"{HEADER},note", "0.20,1.0,1.0"
    lines = [f'{line(0.1 * k)},"wheels, worn"' for k in range(SETTINGS.header_rows + 20)]
    list(reader.read(Arrival("run", "run.csv", header, (*lines[:3], bad, *lines[3:]), fresh=True)))
    assert reader.left_out == [bad]


def test_rows_that_were_left_out_are_told_once(reader: RowReader) -> None:
    reader.left_out = ["0.20,1.0", "x"]
    (said,) = (event.message for event in _left_out(reader, "run.csv"))
    assert said.startswith("run.csv: 2 rows were left out, such as '0.20,1.0': a cell is missing")
    assert not list(_left_out(reader, "run.csv"))
