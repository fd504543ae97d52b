"""Numbers of a program that is being compiled: one for each of LANES rows, calculated together.

An operation adds an instruction to the program. None is fused with another or rearranged: a row comes out the same to
the last bit whatever else its program can do. Constants stay Python floats as long as they can, and what is added to 0
or multiplied by 0 or 1 needs no instruction: the zeros in the frames of an arm cost nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from plants.mujoco_robot.native.program import LANES, TRUTHS, VECTOR, Program, Value, number


@dataclass(frozen=True)
class Condition:
    """A truth in every lane."""

    program: Program
    value: Value

    def __and__(self, other: Condition) -> Condition:
        return self._with("and", other)

    def __or__(self, other: Condition) -> Condition:
        return self._with("or", other)

    def __xor__(self, other: Condition) -> Condition:
        return self._with("xor", other)

    def anywhere(self) -> Value:
        """One bit: whether it holds in any lane."""
        bits = self.program.pure(f"bitcast {TRUTHS} {self.value} to i{LANES}")
        return self.program.pure(f"icmp ne i{LANES} {bits}, 0")

    def _with(self, operation: str, other: Condition) -> Condition:
        value = self.program.pure(f"{operation} {TRUTHS} {self.value}, {other.value}")
        return Condition(self.program, value)


class Lanes:
    """A number in every lane."""

    __slots__ = ("program", "value")
    __array_ufunc__ = None  # a number of numpy's to the left leaves the operation to this class

    def __init__(self, program: Program, value: Value) -> None:
        self.program, self.value = program, value

    def __add__(self, other: Lanes | float) -> Lanes:
        return self if _is(other, 0.0) else self._with("fadd", self, other)

    __radd__ = __add__

    def __sub__(self, other: Lanes | float) -> Lanes:
        return self if _is(other, 0.0) else self._with("fsub", self, other)

    def __rsub__(self, other: float) -> Lanes:
        return -self if _is(other, 0.0) else self._with("fsub", other, self)

    def __mul__(self, other: Lanes | float) -> Lanes | float:
        if _is(other, 0.0):
            return 0.0
        if _is(other, 1.0):
            return self
        return -self if _is(other, -1.0) else self._with("fmul", self, other)

    __rmul__ = __mul__

    def __truediv__(self, other: Lanes | float) -> Lanes:
        return self._with("fdiv", self, other)

    def __rtruediv__(self, other: float) -> Lanes:
        return self._with("fdiv", other, self)

    def __pow__(self, power: int) -> Lanes:
        if power != 2:
            raise NotImplementedError(f"power {power}; only squares are compiled")
        return self._with("fmul", self, self)

    def __neg__(self) -> Lanes:
        return Lanes(self.program, self.program.pure(f"fneg {VECTOR} {self.value}"))

    def __lt__(self, other: Lanes | float) -> Condition:
        return compared(self.program, "olt", self, other)

    def __gt__(self, other: Lanes | float) -> Condition:
        return compared(self.program, "ogt", self, other)

    def __le__(self, other: Lanes | float) -> Condition:
        return compared(self.program, "ole", self, other)

    def __ge__(self, other: Lanes | float) -> Condition:
        return compared(self.program, "oge", self, other)

    def _with(self, operation: str, a: Lanes | float, b: Lanes | float) -> Lanes:
        return Lanes(self.program, self.program.pure(f"{operation} {VECTOR} {value(a)}, {value(b)}"))


Number = Lanes | float
Three = tuple[Number, Number, Number]


def value(x: Number) -> Value:
    return x.value if isinstance(x, Lanes) else number(x)


def lanes(p: Program, x: Number) -> Lanes:
    """A number that may be a constant."""
    return x if isinstance(x, Lanes) else Lanes(p, number(x))


def compared(p: Program, how: str, a: Number, b: Number) -> Condition:
    """how: LLVM's name of a comparison; "o...": not where a or b is no number."""
    return Condition(p, p.pure(f"fcmp {how} {VECTOR} {value(a)}, {value(b)}"))


def never(p: Program) -> Condition:
    return Condition(p, "zeroinitializer")


def where(p: Program, condition: Condition, yes: Number, no: Number) -> Lanes:
    """In each lane `yes` where the condition holds, else `no`."""
    chosen = f"select {TRUTHS} {condition.value}, {VECTOR} {value(yes)}, {VECTOR} {value(no)}"
    return Lanes(p, p.pure(chosen))


def smaller(p: Program, a: Number, b: Number) -> Lanes:
    return where(p, compared(p, "olt", a, b), a, b)


def larger(p: Program, a: Number, b: Number) -> Lanes:
    return where(p, compared(p, "ogt", a, b), a, b)


def size_of(p: Program, x: Number) -> Lanes:
    """|x|"""
    return Lanes(p, p.call("fabs", value(x)))


def load(p: Program, array: Value, at: int) -> Lanes:
    """Number `at` of an array of vectors."""
    return Lanes(p, p.load(VECTOR, p.place(VECTOR, array, at)))


def store(p: Program, x: Number, array: Value, at: int) -> None:
    p.store(VECTOR, value(x), p.place(VECTOR, array, at))


def gather(p: Program, rows: Sequence[Value], at: int) -> Lanes:
    """Number `at` of arrays of numbers, one array for each lane."""
    vector = "undef"
    for lane, row in enumerate(rows):
        x = p.load("double", p.place("double", row, at))
        vector = p.pure(f"insertelement {VECTOR} {vector}, double {x}, i32 {lane}")
    return Lanes(p, vector)


def scatter(p: Program, x: Lanes, rows: Sequence[Value], at: int) -> None:
    """Write number `at` of arrays of numbers, one array for each lane."""
    for lane, row in enumerate(rows):
        one = p.pure(f"extractelement {VECTOR} {x.value}, i32 {lane}")
        p.store("double", one, p.place("double", row, at))


def dot(a: Sequence[Number], b: Sequence[Number]) -> Number:
    out: Number = 0.0
    for x, y in zip(a, b, strict=True):
        out = out + x * y
    return out


def cross(a: Three, b: Three) -> Three:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def added(a: Three, b: Three) -> Three:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def times(a: Three, s: Number) -> Three:
    return a[0] * s, a[1] * s, a[2] * s


def _is(x: Number, constant: float) -> bool:
    return not isinstance(x, Lanes) and float(x) == constant
