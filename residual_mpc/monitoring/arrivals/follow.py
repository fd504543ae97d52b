"""Follow files that grow, folders in which files appear, and a pipe: whole lines of text, or whole files."""

from __future__ import annotations

import os
import select
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from hashlib import blake2b
from pathlib import Path
from typing import BinaryIO

from residual_mpc.errors import BadInput
from residual_mpc.logs.readers.find import SUFFIXES, stem
from residual_mpc.monitoring.settings import ArrivalSettings

TEXT = (".csv", ".tsv")
PIPE = "-"
HEAD = 1024  # bytes by which a log is known again
COPIES = 100  # emptied logs whose copies are known
CHUNK = 1 << 20  # bytes
Identity = tuple[int, int] | Path  # of a file under any name: its device and its number on it


@dataclass(frozen=True)
class Arrival:
    """New content of one log.

    name: of the run; source: the file, for messages. header and lines: the text's header line and its new whole lines;
    file: a log that is not text, now complete. fresh: whether the log begins here.
    """

    name: str
    source: str
    header: str = ""
    lines: tuple[str, ...] = ()
    file: Path | None = None
    fresh: bool = False


def follow_pipe(stream: BinaryIO, settings: ArrivalSettings) -> Iterator[Arrival | None]:
    """A table on a pipe, until its end; None while nothing arrives."""
    tail = Tail("stdin", "stdin")
    handle = stream.fileno()
    while True:
        if not select.select([handle], [], [], settings.poll)[0]:
            yield None
            continue
        content = os.read(handle, min(settings.most, 1 << 16))
        yield from tail.add(content if content else b"\n")
        if not content:
            return


def follow_files(
    paths: tuple[Path, ...], once: bool, settings: ArrivalSettings, sleep: Callable[[float], None] = time.sleep
) -> Iterator[Arrival | None]:
    """Files, and the files of folders, in the order in which they were last written; None when all that is there was
    seen. once: end then.

    Raises BadInput for a path that does not exist.
    """
    for path in paths:
        if not path.exists():
            raise BadInput("file or folder not found", str(path), "give a file, a folder, or - for a pipe")
    tails: dict[Identity, Tail] = {}
    emptied: dict[bytes, Tail] = {}  # logs that were emptied, by how they began: a copy of one may turn up
    sizes: dict[Path, int] = {}
    done: set[tuple[Identity, int | Path]] = set()
    while True:
        for path in _logs(paths):
            same = _identity(path)
            if path.name.lower().endswith(TEXT):
                tail = tails[same] = _tail_of(path, same, tails, emptied)
                yield from _grown(path, tail, settings)
                continue
            # the content under any name, and the file under this one
            marks: set[tuple[Identity, int | Path]] = {(same, _changed(path)), (same, path)}
            if marks & done:
                continue
            if once or sizes.get(path) == _size(path) > 0:  # a format that is read whole: wait until it rests
                done |= marks
                yield Arrival(stem(path), str(path), file=path, fresh=True)
            else:
                sizes[path] = _size(path)
        yield None
        if once:
            return
        sleep(settings.poll)


def _tail_of(path: Path, same: Identity, tails: Mapping[Identity, Tail], emptied: dict[bytes, Tail]) -> Tail:
    """What was read of a log so far: of the file, renamed or not, of one that a longer copy of itself replaced, or of
    one that was copied and then emptied."""
    size = _size(path)
    mine = tails.get(same)
    if mine is not None and mine.path == path and mine.at == size:  # nothing happened
        return mine
    others = [tail for tail in tails.values() if tail.path == path and tail is not mine]
    for tail in (*((mine,) if mine is not None else ()), *others):
        if size >= tail.at and tail.is_of(path):
            tail.path = path
            return tail
    for tail in (*tails.values(), *emptied.values()):
        if tail.path != path and size >= tail.at and tail.is_copied_to(path):
            return tail.copied(path)
    known = [tail for tail in others if tail.header or tail.earlier]
    before = next(iter(known), mine if mine is not None and mine.path == path else None)
    if before is not None and before.head:
        emptied[before.head] = before
        while len(emptied) > COPIES:
            emptied.pop(next(iter(emptied)))
    return Tail(stem(path), str(path), path, None if before is None else before.header or before.earlier)


class Tail:
    """The lines of one growing text: what is after the last line's end waits for the rest of its line. earlier: the
    header of the log that stood here before it was emptied: its logger may go on without another one."""

    def __init__(self, name: str, source: str, path: Path | None = None, earlier: str | None = None) -> None:
        self.name, self.source, self.path = name, source, path
        self.at = 0  # bytes that were read
        self.head = b""  # the first of them
        self.header: str | None = None
        self.earlier = earlier
        self._rest = b""
        self._begun = False  # whether a row was read
        self._content = blake2b()  # of all that was read

    def copied(self, path: Path) -> Tail:
        """The same log in another file, read as far."""
        copy = Tail(stem(path), str(path), path)
        copy.at, copy.head, copy.header = self.at, self.head, self.header
        copy._rest, copy._begun, copy._content = self._rest, self._begun, self._content.copy()
        return copy

    def is_copied_to(self, path: Path) -> bool:
        """Whether a file begins with all that was read, at least one row."""
        content, left = blake2b(), self.at
        try:
            with open(path, "rb") as file:
                if not self._begun or file.read(len(self.head)) != self.head:
                    return False
                file.seek(0)
                while left and (part := file.read(min(left, CHUNK))):
                    content.update(part)
                    left -= len(part)
        except OSError:
            return False
        return not left and content.digest() == self._content.digest()

    def is_of(self, path: Path) -> bool:
        """Whether a file still begins as what was read: a log that is renamed (rotated) is the same log, and another
        one may have got the place on the disk of one that was removed."""
        try:
            with open(path, "rb") as file:
                return file.read(len(self.head)) == self.head
        except OSError:  # not now
            return True

    def add(self, content: bytes) -> Iterator[Arrival]:
        """The whole lines that these bytes complete."""
        self.head += content[: max(HEAD - len(self.head), 0)]
        self.at += len(content)
        self._content.update(content)
        # a logger that goes on where it was in a file that was emptied leaves a hole, which reads as zeros
        whole, end, self._rest = (self._rest + content.replace(b"\0", b"")).rpartition(b"\n")
        if not end:
            return
        lines = [line for line in whole.decode("utf-8", "replace").splitlines() if line.strip()]
        fresh = self.header is None
        if fresh and lines and self.earlier is not None and _continues(self.earlier, lines[0]):
            self.header, fresh = self.earlier, False
        elif fresh and lines:
            self.header, lines = lines[0].removeprefix("\ufeff"), lines[1:]
        self._begun |= bool(lines)
        if lines and self.header is not None:
            yield Arrival(self.name, self.source, self.header, tuple(lines), fresh=fresh)
        elif fresh and self.header is not None:
            yield Arrival(self.name, self.source, self.header, (), fresh=True)


def _continues(header: str, line: str) -> bool:
    """Whether a line is a row under a header, and no header itself."""
    mark = delimiter(header)
    names, cells = header.split(mark), line.split(mark)
    numbers = any(cell.strip() and is_number(cell) for cell in cells)
    return len(cells) == len(names) and numbers and not any(a == b for a, b in zip(names, cells, strict=True))


def delimiter(header: str) -> str:
    """What stands between the cells."""
    return max(",;\t", key=lambda m: (header.count(m), -",;\t".index(m)))


def is_number(cell: str) -> bool:
    """Whether a cell is a number or empty."""
    try:
        float(cell.strip() or 0.0)
    except ValueError:
        return False
    return True


def _grown(path: Path, tail: Tail, settings: ArrivalSettings) -> Iterator[Arrival]:
    """What was appended since the last look."""
    while _size(path) > tail.at:
        try:
            with open(path, "rb") as file:
                file.seek(tail.at)
                content = file.read(settings.most)
        except OSError:  # removed in between
            return
        if not content:
            return
        yield from tail.add(content)


def _logs(paths: tuple[Path, ...]) -> list[Path]:
    """The logs that there are now, oldest first."""
    found: dict[Path, float] = {}
    for path in paths:
        inside = [path] if not path.is_dir() else [p for p in path.iterdir() if p.name.lower().endswith(SUFFIXES)]
        for file in inside:
            if not file.name.startswith("."):
                found[file] = _written(file)
    return sorted(found, key=lambda p: (found[p], p.name))


def _identity(path: Path) -> Identity:
    """The path itself where the file system gives files no numbers."""
    try:
        found = path.stat()
    except OSError:
        return path
    return (found.st_dev, found.st_ino) if found.st_ino else path


def _changed(path: Path) -> int:
    """ns: when its content was last written."""
    try:
        return path.stat().st_mtime_ns
    except OSError:
        return 0


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError:
        return 0


def _written(path: Path) -> float:
    try:
        return path.stat().st_mtime
    except OSError:
        return 0.0
