"""Which line of a text table names its columns."""

import pytest

from residual_mpc.logs.readers.tables.header_line import header_cells, header_line


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("t,x\n0,1\n", ["t", "x"]),
        ("# recorded on a bench\n\nt,x\n0,1\n", ["t", "x"]),
        ("# t,x\n0,1\n", ["t", "x"]),
        ("# t,x\n# s,m\n0,1\n", ["t", "x"]),  # a line of units
        ("# t,x\n2026-11-28 02:05:41.120,\n", ["t", "x"]),
        ("# t x\n0.0 1.0\n", ["t x"]),  # separated by blanks, which is refused later, under its own names
        ("\tt\tx\n0\t0.0\t1.0\n", ["", "t", "x"]),  # an index without a name
    ],
)
def test_the_header_is_found(text: str, expected: list[str]) -> None:
    lines = text.encode().splitlines(keepends=True)
    at = header_line(lines)
    assert at is not None
    cells, _ = header_cells(lines[at].decode().rstrip("\n"))
    assert [c.strip() for c in cells] == expected
