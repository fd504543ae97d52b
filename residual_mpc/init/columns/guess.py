"""One thing that was guessed, and one that the user has to mend."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Guess:
    """Attributes:
    what: what was guessed: a name of the log format, a key of the robot file, or "unit of COLUMN" and the like.
    value: the answer, as a text.
    why: the reason, as a sentence without its full stop.
    sure: 0 to 1.
    rivals: other answers that are about as plausible.
    """

    what: str
    value: str
    why: str
    sure: float
    rivals: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not 0.0 <= self.sure <= 1.0:
            raise ValueError(f"sure must be between 0 and 1, got {self.sure}")

    def __str__(self) -> str:
        rivals = f"; or {' or '.join(self.rivals)}" if self.rivals else ""
        return f"{self.what} = {self.value} ({self.sure:.0%}): {self.why}{rivals}"


@dataclass(frozen=True)
class LogCorrection:
    """What no robot file can say of a column, so that the log has to be written anew: new = factor * old + offset.

    Attributes:
        column: of the table.
        factor, offset: offset in the new unit.
        why: the reason, as a sentence without its full stop.
        sure: 0 to 1.
    """

    column: str
    factor: float
    offset: float
    why: str
    sure: float

    @property
    def formula(self) -> str:
        """Such as `0.0174533 * elbow - 1.5708`."""
        name = self.column if self.column.isidentifier() else f'"{self.column}"'
        scaled = {1.0: name, -1.0: f"-{name}"}.get(self.factor, f"{self.factor:.9g} * {name}")
        return scaled if self.offset == 0.0 else f"{scaled} {'+' if self.offset > 0 else '-'} {abs(self.offset):.6g}"

    def __str__(self) -> str:
        return f"write the column {self.column} as {self.formula} ({self.sure:.0%}): {self.why}"
