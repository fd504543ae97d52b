"""Check the structure of a version 5 MATLAB file before scipy reads it, since a damaged file can crash scipy.

The layout follows the document "MAT-File Format" of MathWorks: elements with a type and a size, and matrices made of
elements.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from math import prod
from pathlib import Path

HEADER = 128  # bytes
MATRIX, COMPRESSED = 14, 15
SIZES = {1: 1, 2: 1, 3: 2, 4: 2, 5: 4, 6: 4, 7: 4, 9: 8, 12: 8, 13: 8}  # bytes of a number by type
TEXTS = {16: 1, 17: 2, 18: 4}  # of a character
CELL, STRUCT, OBJECT, CHAR, SPARSE, FUNCTION, OPAQUE = 1, 2, 3, 4, 5, 16, 17
NUMERIC = range(6, 16)
COMPLEX = 0x08
DEEPEST = 40  # structures within structures


class Unsound(ValueError):
    """A file whose structure is damaged."""


class Unsupported(Unsound):
    """A variable of a type that is not read."""


@dataclass(frozen=True)
class Element:
    """kind: type of the content. content: without padding."""

    kind: int
    content: memoryview


def sound_variables(path: Path) -> tuple[str, ...]:
    """The names of the variables that can be read: arrays of numbers and text, and structures and cells of them.

    Raises:
        Unsound: an element of an unknown type, one that ends beyond the file, or a matrix whose parts do not fit.
    """
    raw = path.read_bytes()
    order = {b"IM": "little", b"MI": "big"}.get(raw[126:128])
    if order is None or len(raw) < HEADER:
        raise Unsound("no MATLAB header")
    names = []
    for element in _elements(memoryview(raw)[HEADER:], order, top=True):
        if element.kind == COMPRESSED:
            inflated = memoryview(zlib.decompress(element.content))
            inner = list(_elements(inflated, order))
            if len(inner) != 1:
                raise Unsound("a compressed element must hold one matrix")
            element = inner[0]
        try:
            names.append(_check_matrix(element, order, 0))
        except Unsupported:
            continue
    return tuple(name for name in names if name)


def _elements(data: memoryview, order: str, top: bool = False) -> Iterator[Element]:
    at = 0
    while at < len(data):
        if len(data) - at < 8:
            raise Unsound("the file ends within an element")
        kind, size = _number(data[at : at + 4], order), _number(data[at + 4 : at + 8], order)
        if kind >> 16:  # type, size and up to four bytes of content in eight
            kind, size = kind & 0xFFFF, kind >> 16
            start, end = at + 4, at + 8
            if size > 4:
                raise Unsound("a small element must have at most four bytes")
        else:
            start = at + 8
            end = start + size + (-size % 8 if kind != COMPRESSED else 0)
        if kind not in SIZES and kind not in TEXTS and kind not in (MATRIX, COMPRESSED):
            raise Unsound(f"an element of the unknown type {kind}")
        if start + size > len(data) or kind == COMPRESSED and not top:
            raise Unsound("an element ends beyond the file")
        yield Element(kind, data[start : start + size])
        at = end


def _number(raw: memoryview, order: str) -> int:
    return int.from_bytes(raw, "little" if order == "little" else "big")


def _check_matrix(element: Element, order: str, depth: int) -> str:
    """The matrix's name."""
    if element.kind != MATRIX or depth > DEEPEST:
        raise Unsound("a matrix is missing")
    if not len(element.content):
        return ""  # an empty cell
    parts = list(_elements(element.content, order))
    flags = parts[0]
    if flags.kind != 6 or len(flags.content) != 8:
        raise Unsound("a matrix must begin with its flags")
    word = _number(flags.content[:4], order)
    what, is_complex = word & 0xFF, bool(word >> 8 & COMPLEX)
    if what in (FUNCTION, OPAQUE):
        raise Unsupported("an object of MATLAB, such as a table, a time series or a function")
    if len(parts) < 3 or parts[1].kind != 5 or len(parts[1].content) % 4 or parts[2].kind != 1:
        raise Unsound("a matrix must have its size and its name")
    raw = parts[1].content
    sides = [_number(raw[i : i + 4], order) for i in range(0, len(raw), 4)]
    if len(sides) < 2 or max(sides) >= 2**31:
        raise Unsound("a matrix must have two sides or more")
    _check_parts(what, is_complex, sides, parts[3:], order, depth)
    return bytes(parts[2].content).decode("latin-1")


def _check_parts(what: int, is_complex: bool, sides: list[int], parts: list[Element], order: str, depth: int) -> None:
    count = prod(sides)
    if what in NUMERIC:
        if len(parts) != 1 + is_complex or any(p.kind not in SIZES for p in parts):
            raise Unsound("a matrix of numbers without its numbers")
        if any(len(p.content) != count * SIZES[p.kind] for p in parts):
            raise Unsound("a matrix must have as many numbers as its sides say")
    elif what == CHAR:
        sizes = {**SIZES, **TEXTS}
        if len(parts) != 1 or parts[0].kind not in sizes or len(parts[0].content) % sizes[parts[0].kind]:
            raise Unsound("a text without its characters")
    elif what == CELL:
        if len(parts) != count:
            raise Unsound("a cell array must have as many cells as its sides say")
        for part in parts:
            _check_matrix(part, order, depth + 1)
    elif what in (STRUCT, OBJECT):
        _check_fields(parts[1:] if what == OBJECT else parts, count, order, depth)
    elif what == SPARSE:
        raise Unsupported("a sparse matrix")
    else:
        raise Unsound(f"a matrix of the unknown class {what}")


def _check_fields(parts: list[Element], count: int, order: str, depth: int) -> None:
    if len(parts) < 2 or parts[0].kind != 5 or len(parts[0].content) != 4 or parts[1].kind != 1:
        raise Unsound("a structure without the names of its fields")
    length = _number(parts[0].content, order)
    if not 0 < length <= 4096 or len(parts[1].content) % length:
        raise Unsound("a structure must name its fields")
    fields = len(parts[1].content) // length
    if len(parts) - 2 != fields * count:
        raise Unsound("a structure must have a value for each of its fields")
    for part in parts[2:]:
        _check_matrix(part, order, depth + 1)
