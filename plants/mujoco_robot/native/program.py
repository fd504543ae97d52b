"""A function of vectors under construction, as text in LLVM's intermediate language.

llvmlite's own builder makes the same text from an object for each instruction, which takes five times as long: longer
than the translation into machine code.
"""

from __future__ import annotations

import struct
from collections.abc import Callable

LANES = 8  # rows that a vector holds: the width of AVX-512, two of AVX2, four of NEON
VECTOR = f"<{LANES} x double>"
INTEGERS = f"<{LANES} x i64>"
TRUTHS = f"<{LANES} x i1>"

Value = str  # the name of a value, or a constant


class Program:
    """The instructions so far. A value that was calculated before in the same block is not calculated again, and
    neither is one loaded again before anything was stored."""

    def __init__(self) -> None:
        self._lines: list[str] = []
        self._rooms: list[str] = []
        self._declared: dict[str, str] = {}
        self._known: dict[str, Value] = {}
        self._loaded: dict[str, Value] = {}
        self._count = 0
        self.block = "entry"

    def text(self, name: str, arguments: list[str]) -> str:
        """The whole module: one function that returns nothing."""
        head = f"define void @{name}({', '.join(arguments)}) {{\nentry:"
        body = [*self._declared.values(), head, *self._rooms, *self._lines, "  ret void", "}"]
        return "\n".join(body) + "\n"

    def pure(self, instruction: str) -> Value:
        """The result of an instruction that depends on nothing but its operands."""
        known = self._known.get(instruction)
        if known is None:
            known = self._known[instruction] = self._new(instruction)
        return known

    def load(self, kind: str, place: Value) -> Value:
        """What is at a place in memory."""
        instruction = f"load {kind}, ptr {place}, align 8"
        known = self._loaded.get(instruction)
        if known is None:
            known = self._loaded[instruction] = self._new(instruction)
        return known

    def store(self, kind: str, value: Value, place: Value) -> None:
        self._loaded.clear()
        self._lines.append(f"  store {kind} {value}, ptr {place}, align 8")
        self._loaded[f"load {kind}, ptr {place}, align 8"] = value

    def place(self, kind: str, array: Value, at: Value | int) -> Value:
        """Of one element of an array."""
        return self.pure(f"getelementptr {kind}, ptr {array}, i64 {at}")

    def memory(self, kind: str, size: int) -> Value:
        """Room for so many values, the same in every round of a loop."""
        name = self._name()
        self._rooms.append(f"  {name} = alloca {kind}, i64 {size}, align 64")
        return name

    def call(self, name: str, value: Value) -> Value:
        """One of LLVM's own functions of a vector."""
        full = f"@llvm.{name}.v{LANES}f64"
        self._declared.setdefault(full, f"declare {VECTOR} {full}({VECTOR})")
        return self.pure(f"call {VECTOR} {full}({VECTOR} {value})")

    def label(self, word: str) -> str:
        """A name for a block."""
        self._count += 1
        return f"{word}{self._count}"

    def begin(self, block: str) -> None:
        """Go on in a block. What was known before may not have been calculated on the way there."""
        self._lines.append(f"{block}:")
        self._known.clear()
        self._loaded.clear()
        self.block = block

    def jump(self, block: str) -> None:
        self._lines.append(f"  br label %{block}")

    def branch(self, condition: Value, yes: str, no: str) -> None:
        self._lines.append(f"  br i1 {condition}, label %{yes}, label %{no}")

    def loop(self, count: Value, body: Callable[[Value], None]) -> None:
        """body(number) so many times."""
        head, inside, end = (self.label(word) for word in ("head", "inside", "end"))
        before, k, following = self.block, self._name(), self._name()
        self.jump(head)
        self.begin(head)
        self._lines.append("")  # the phi names the block in which the body ends
        phi = len(self._lines) - 1
        self.branch(self.pure(f"icmp slt i64 {k}, {count}"), inside, end)
        self.begin(inside)
        body(k)
        self._lines.append(f"  {following} = add i64 {k}, 1")
        self._lines[phi] = f"  {k} = phi i64 [ 0, %{before} ], [ {following}, %{self.block} ]"
        self.jump(head)
        self.begin(end)

    def _new(self, instruction: str) -> Value:
        name = self._name()
        self._lines.append(f"  {name} = {instruction}")
        return name

    def _name(self) -> Value:
        self._count += 1
        return f"%v{self._count}"


def number(x: float) -> Value:
    """A constant in every lane."""
    return f"splat (double 0x{struct.unpack('>Q', struct.pack('>d', float(x)))[0]:016X})"


def integer(x: int) -> Value:
    return f"splat (i64 {x})"
