"""The one exception for faults in what a user gave."""

from __future__ import annotations


class BadInput(Exception):
    """A file, option or value of the user's cannot be used; the command line ends with exit status 2.

    Args:
        what: what came and what was wanted, as a sentence without its full stop.
        where: the file, key, row or option at fault; empty where `what` already says it.
        remedy: how to mend it, as a sentence without its full stop; empty where `what` makes it plain.
    """

    def __init__(self, what: str, where: str = "", remedy: str = "") -> None:
        super().__init__(what, where, remedy)  # all three, so that it survives pickling between processes
        self.what = what
        self.where = where
        self.remedy = remedy

    def __str__(self) -> str:
        text = f"{self.where}: {self.what}" if self.where else self.what
        sentences = [text, self.remedy[:1].upper() + self.remedy[1:]]
        return " ".join(s if s.endswith((".", "?", "!")) else f"{s}." for s in sentences if s)
