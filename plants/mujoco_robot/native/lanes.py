"""Numbers of a program that is being compiled: one for each of LANES rows, calculated together.

An operation adds an instruction to the program. Constants stay Python floats as long as they can, and what is added to
0 or multiplied by 0 or 1 needs no instruction: the zeros in the frames of an arm cost nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

LANES = 8  # rows that a vector holds: the width of AVX-512, two of AVX2, four of NEON

FLAGS = ("contract",)  # a product and a sum may be one instruction; nothing else is rearranged


class Program:
    """Where the instructions go: a function under construction in LLVM's intermediate language."""

    def __init__(self, builder: Any, double: Any) -> None:
        from llvmlite import ir

        self.ir, self.builder = ir, builder
        self.vector = ir.VectorType(double, LANES)
        self.double = double

    def constant(self, x: float) -> Any:
        return self.ir.Constant(self.vector, [self.ir.Constant(self.double, float(x))] * LANES)

    def value(self, x: Lanes | float) -> Any:
        """The vector of a number."""
        return x.value if isinstance(x, Lanes) else self.constant(x)

    def load(self, array: Any, at: int) -> Lanes:
        """Number `at` of an array of vectors."""
        place = self.builder.gep(array, [self.ir.Constant(self.ir.IntType(64), at)])
        return Lanes(self, self.builder.load(place, align=8))

    def store(self, x: Lanes | float, array: Any, at: int) -> None:
        place = self.builder.gep(array, [self.ir.Constant(self.ir.IntType(64), at)])
        self.builder.store(self.value(x), place, align=8)

    def memory(self, kind: Any, size: int) -> Any:
        """Room for so many values, the same in every round of a loop."""
        with self.builder.goto_entry_block():
            return self.builder.alloca(kind, size=size)

    def gather(self, rows: Sequence[Any], count: int) -> list[Lanes]:
        """The first numbers of arrays of numbers, one array for each lane."""
        whole, places = self.ir.IntType(64), [self.ir.IntType(32)(lane) for lane in range(LANES)]
        out = []
        for i in range(count):
            vector = self.ir.Constant(self.vector, self.ir.Undefined)
            for row, lane in zip(rows, places, strict=True):
                x = self.builder.load(self.builder.gep(row, [self.ir.Constant(whole, i)]), align=8)
                vector = self.builder.insert_element(vector, x, lane)
            out.append(Lanes(self, vector))
        return out

    def scatter(self, x: Lanes, rows: Sequence[Any], at: int) -> None:
        """Write number `at` of arrays of numbers, one array for each lane."""
        for lane, row in enumerate(rows):
            one = self.builder.extract_element(x.value, self.ir.IntType(32)(lane))
            place = self.builder.gep(row, [self.ir.Constant(self.ir.IntType(64), at)])
            self.builder.store(one, place, align=8)

    def call(self, name: str, *x: Lanes | float) -> Lanes:
        """One of LLVM's functions of vectors."""
        kind = self.ir.FunctionType(self.vector, [self.vector] * len(x))
        module = self.builder.module
        full = f"llvm.{name}.v{LANES}f64"
        function = module.globals.get(full) or self.ir.Function(module, kind, full)
        return Lanes(self, self.builder.call(function, [self.value(v) for v in x]))

    def any(self, condition: Any) -> Any:
        """One bit: whether a condition holds in any lane."""
        bits = self.builder.bitcast(condition, self.ir.IntType(LANES))
        return self.builder.icmp_unsigned("!=", bits, self.ir.Constant(self.ir.IntType(LANES), 0))


class Lanes:
    """A number in every lane."""

    __slots__ = ("program", "value")

    def __init__(self, program: Program, value: Any) -> None:
        self.program, self.value = program, value

    def __add__(self, other: Lanes | float) -> Lanes:
        return self if _is(other, 0.0) else self._with("fadd", self, other)

    __radd__ = __add__

    def __sub__(self, other: Lanes | float) -> Lanes:
        return self if _is(other, 0.0) else self._with("fsub", self, other)

    def __rsub__(self, other: float) -> Lanes:
        return -self if _is(other, 0.0) else self._with("fsub", other, self)

    def __mul__(self, other: Lanes | float) -> Lanes | float:  # type: ignore[override]
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

    def __neg__(self) -> Lanes:
        return Lanes(self.program, self.program.builder.fneg(self.value, flags=FLAGS))

    def __lt__(self, other: Lanes | float) -> Any:
        return self.program.builder.fcmp_ordered("<", self.value, self.program.value(other))

    def __gt__(self, other: Lanes | float) -> Any:
        return self.program.builder.fcmp_ordered(">", self.value, self.program.value(other))

    def __le__(self, other: Lanes | float) -> Any:
        return self.program.builder.fcmp_ordered("<=", self.value, self.program.value(other))

    def __ge__(self, other: Lanes | float) -> Any:
        return self.program.builder.fcmp_ordered(">=", self.value, self.program.value(other))

    def differs(self, other: Lanes | float) -> Any:
        """Condition: not the same number, or none."""
        return self.program.builder.fcmp_unordered("!=", self.value, self.program.value(other))

    def _with(self, operation: str, a: Lanes | float, b: Lanes | float) -> Lanes:
        build: Callable[..., Any] = getattr(self.program.builder, operation)
        return Lanes(self.program, build(self.program.value(a), self.program.value(b), flags=FLAGS))


Number = Lanes | float
Three = tuple[Number, Number, Number]


def _is(x: Number, constant: float) -> bool:
    return not isinstance(x, Lanes) and float(x) == constant


def where(program: Program, condition: Any, yes: Number, no: Number) -> Lanes:
    """In each lane `yes` where the condition holds, else `no`."""
    return Lanes(program, program.builder.select(condition, program.value(yes), program.value(no)))


def smaller(program: Program, a: Number, b: Number) -> Lanes:
    return where(program, program.builder.fcmp_ordered("<", program.value(a), program.value(b)), a, b)


def larger(program: Program, a: Number, b: Number) -> Lanes:
    return where(program, program.builder.fcmp_ordered(">", program.value(a), program.value(b)), a, b)


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


# sin and cos on [-pi/4, pi/4]: polynomials of the least largest relative error, as in fdlibm (k_sin.c, k_cos.c)
SIN = (-1.66666666666666324348e-01, 8.33333333332248946124e-03, -1.98412698298579493134e-04,
       2.75573137070700676789e-06, -2.50507602534068634195e-08, 1.58969099521155010221e-10)  # fmt: skip
COS = (4.16666666666666019037e-02, -1.38888888888741095749e-03, 2.48015872894767294178e-05,
       -2.75573143513906633035e-07, 2.08757232129817482790e-09, -1.13596475577881948265e-11)  # fmt: skip
HALF_PI = (1.57079632673412561417e00, 6.07710050630396597660e-11, 2.02226624879595063154e-21)  # in three parts


def sine_and_cosine(p: Program, x: Lanes) -> tuple[Lanes, Lanes]:
    """Of angles up to some 1e5 rad, to the last digits; the quadrant is subtracted in three parts (Cody and Waite)."""
    k = p.call("rint", x * (2.0 / 3.14159265358979323846))
    r: Any = x
    for part in HALF_PI:
        r = r - k * part
    z = r * r
    sine, cosine = _polynomial(SIN, z), _polynomial(COS, z)
    s = r + r * z * sine
    c = 1.0 - (0.5 * z - z * z * cosine)
    quadrant = p.builder.fptosi(k.value, p.ir.VectorType(p.ir.IntType(64), LANES))
    bit = _bits(p, quadrant)
    odd, second = bit(1), bit(2)
    third = p.builder.xor(odd, second)
    swapped_s, swapped_c = where(p, odd, c, s), where(p, odd, s, c)
    return where(p, second, -swapped_s, swapped_s), where(p, third, -swapped_c, swapped_c)


def _polynomial(coefficients: Sequence[float], z: Any) -> Any:
    out: Any = coefficients[-1]
    for c in reversed(coefficients[:-1]):
        out = c + z * out
    return out


def _bits(p: Program, integers: Any) -> Callable[[int], Any]:
    kind = p.ir.VectorType(p.ir.IntType(64), LANES)

    def bit(mask: int) -> Any:
        masks = p.ir.Constant(kind, [p.ir.Constant(p.ir.IntType(64), mask)] * LANES)
        return p.builder.icmp_unsigned("!=", p.builder.and_(integers, masks), p.ir.Constant(kind, None))

    return bit
