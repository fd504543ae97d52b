"""The line of a text table that names its columns: it may have comments above it, and may itself be marked as one."""

from __future__ import annotations

import csv
from collections.abc import Sequence

SEPARATORS = ",;\t"
COMMENT = "#"


def header_line(lines: Sequence[bytes]) -> int | None:
    """The index of the header; None where all lines are blank.

    Blank lines and comments above it are skipped. A comment is the header where a row of as many cells follows, as
    `numpy.savetxt` writes it, the first of several (a line of units may stand below it), or where nothing follows.
    """
    comments: list[int] = []
    for i, line in enumerate(lines):
        if line.lstrip().startswith(COMMENT.encode()):
            comments.append(i)
        elif line.strip():
            return next((k for k in comments if _names(lines[k], line)), i)
    return comments[-1] if comments else None


def header_cells(line: str) -> tuple[list[str], str]:
    """The cells of a header, without the mark of a comment, and their separator."""
    line = line.lstrip(" ").lstrip(COMMENT)  # a tab is an empty first cell
    separator = max(SEPARATORS, key=lambda mark: (line.count(mark), -SEPARATORS.index(mark)))
    return _split(line, separator), separator


def _names(comment: bytes, row: bytes) -> bool:
    """Whether a comment names the cells of a row: there are as many, and the row holds a number or a date, unlike a
    header."""
    names, separator = header_cells(comment.decode("utf-8", "replace"))
    cells = _split(row.decode("utf-8", "replace"), separator)
    return len(cells) == len(names) and any(_is_data(part) for cell in cells for part in cell.split())


def _split(line: str, separator: str) -> list[str]:
    return next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])


def _is_data(word: str) -> bool:
    """Whether a word begins like a number or a date, or is none."""
    return word.lstrip("+-.")[:1].isdigit() or word.lower() in ("nan", "inf", "-inf")
