"""How results show themselves: as text, and in a notebook."""

from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pandas import DataFrame


def brief(result: object, words: str) -> str:
    """One line for a Python prompt: the type of the result and the first line of its text."""
    return f"<{type(result).__name__}: {words.splitlines()[0] if words else 'empty'}>"


def page(lines: Sequence[str], table: "DataFrame | None" = None) -> str:
    """HTML of a result: its lines, then its table."""
    rows = "" if table is None or table.empty else table.to_html(index=False, border=0, float_format="{:.4g}".format)
    return f"<pre>{escape(chr(10).join(lines))}</pre>{rows}"
