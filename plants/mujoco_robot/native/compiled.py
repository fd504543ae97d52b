"""A program in machine code: many steps of many rows, as a function of arrays."""

from __future__ import annotations

from ctypes import CFUNCTYPE, c_int64, c_void_p
from dataclasses import dataclass
from functools import lru_cache
from time import perf_counter
from typing import Any

import numpy as np

from plants.mujoco_robot.native.chain import Chain, sizes
from plants.mujoco_robot.native.changing import Changing, Rewriting
from plants.mujoco_robot.native.integrate import trace
from plants.mujoco_robot.native.lanes import gather, load, scatter, store
from plants.mujoco_robot.native.program import LANES, VECTOR, Program, Value

PROGRAMS = 256  # that a process keeps, about a megabyte each
OPTIMISING = 4.0  # times what the plain translation took, that the optimised one takes
SAVED = 0.6  # of the running time that optimised code saves


@dataclass(frozen=True, eq=False)
class Rollout:
    """What the steps of some rows work on, for whole blocks of LANES rows; the arrays are C-contiguous.

    numbers (blocks, sizes, LANES); state (blocks, 3 n, LANES): positions, velocities and accelerations, gone on with in
    place; controls (rows, steps, nu), followed by what is switched on where a program asks for it; positions,
    velocities (rows, steps + 1, n): written from the second node on; outputs (rows, steps + 1, nu): the actuators'
    forces in the step from a node on, written where a program records them; forces (blocks, nu, LANES): of the last
    step; failed (blocks, 1, LANES): 1 where a step is not exact.
    """

    numbers: np.ndarray
    state: np.ndarray
    controls: np.ndarray
    positions: np.ndarray
    velocities: np.ndarray
    outputs: np.ndarray
    forces: np.ndarray
    failed: np.ndarray


class Compiled:
    """The machine code of a chain's steps, and of what is rewritten between them.

    It is compiled without optimisation at first, and again with it once the time that this would have saved so far
    equals its cost: whatever is still to come, at most twice the least possible time is spent (ski rental; Karlin et
    al. 1988). The results are the same to the last bit.
    """

    def __init__(self, chain: Chain, changing: Changing | None = None) -> None:
        self._source = chain, changing
        text = text_of(*self._source)
        started = perf_counter()
        self._roll = _function(text, 0)
        self._worth = OPTIMISING / SAVED * (perf_counter() - started)  # s of running, after which it is optimised
        self._spent, self._better = 0.0, False  # s that it has run, and whether it was optimised

    def __call__(self, on: Rollout, begin: int, end: int, each: int) -> None:
        """Steps begin to end - 1, each of so many of the model's."""
        (_, steps, sent), n, nu = on.controls.shape, on.positions.shape[2], on.outputs.shape[2]
        arrays = (on.numbers, on.state, on.controls, on.positions, on.velocities, on.outputs, on.forces, on.failed)
        skipped = (0, 0, begin * sent, (begin + 1) * n, (begin + 1) * n, begin * nu, 0, 0)
        places = [a.ctypes.data + a.itemsize * k for a, k in zip(arrays, skipped, strict=True)]
        sizes_of_rows = steps * sent, (steps + 1) * n, (steps + 1) * nu
        assert all(a.dtype == np.float64 and a.flags.c_contiguous for a in arrays)
        if not self._better and self._spent > self._worth:
            self._roll, self._better = _function(text_of(*self._source), 1), True
        started = perf_counter()
        self._roll(*places, len(on.state), end - begin, each, *sizes_of_rows)
        self._spent += perf_counter() - started


NAME = "roll"  # of a program's function
ARRAYS = ("numbers", "state", "controls", "positions", "velocities", "outputs", "forces", "failed")
COUNTS = ("blocks", "steps", "each", "sent", "node", "output")  # the last three: the sizes of a row


def text_of(chain: Chain, changing: Changing | None = None) -> str:
    """The program in LLVM's language: the arrays of Rollout, then the numbers of blocks, of steps and of the model's
    steps in each, and the sizes of a row in controls, in positions and in outputs."""
    p, n, nu = Program(), len(chain.joints), len(chain.actuators)
    sent = nu if changing is None or not changing.switched else 2 * nu
    size = sizes(chain) + (0 if changing is None else changing.count)
    held = p.memory(VECTOR, max(sent, 1))

    def row_of(kind: str, array: Value, index: Value, size: int | Value) -> Value:
        return p.place(kind, array, p.pure(f"mul i64 {index}, {size}"))

    def block(b: Value) -> None:
        mine, row = row_of(VECTOR, "%state", b, 3 * n), row_of(VECTOR, "%numbers", b, size)
        force, wrong = row_of(VECTOR, "%forces", b, nu), row_of(VECTOR, "%failed", b, 1)
        first = p.pure(f"mul i64 {b}, {LANES}")
        lanes = [p.pure(f"add i64 {first}, {lane}") for lane in range(LANES)]
        commands, places, rates, written = (
            [row_of("double", array, lane, per) for lane in lanes]
            for array, per in (
                ("%controls", "%sent"), ("%positions", "%node"), ("%velocities", "%node"), ("%outputs", "%output"),
            )
        )  # fmt: skip

        def one(k: Value) -> None:
            now = [row_of("double", c, k, sent) for c in commands]
            for i in range(sent):
                store(p, gather(p, now, i), held, i)
            if changing is not None:
                Rewriting(p, chain, changing, row, mine, held, force)()
            p.loop("%each", lambda j: trace(p, chain, row, mine, held, force, wrong))
            for arrays, begin in ((places, 0), (rates, n)):
                to = [row_of("double", a, k, n) for a in arrays]
                for i in range(n):
                    scatter(p, load(p, mine, begin + i), to, i)
            if changing is not None and changing.records:
                to = [row_of("double", a, k, nu) for a in written]
                for i in range(nu):
                    scatter(p, load(p, force, i), to, i)

        p.loop("%steps", one)

    p.loop("%blocks", block)
    return p.text(NAME, [*(f"ptr noalias %{a}" for a in ARRAYS), *(f"i64 %{c}" for c in COUNTS)])


@lru_cache(maxsize=PROGRAMS)
def compiled(chain: Chain, changing: Changing | None = None) -> Compiled:
    """The program, made once in a process as long as it is not forgotten."""
    return Compiled(chain, changing)


def _function(text: str, level: int) -> Any:
    engine, address = engine_of(text, level, NAME)
    function = CFUNCTYPE(None, *[c_void_p] * len(ARRAYS), *[c_int64] * len(COUNTS))(address)
    function.engine = engine  # type: ignore[attr-defined]  # which owns the code
    return function


def engine_of(text: str, level: int, name: str) -> tuple[Any, int]:
    """Compile a module for this processor: the engine that owns the machine code, and the address of the function
    `name`.

    level: of the translation; 0 takes a quarter of the time of 1, and its code two to three times as long. Passes over
    the text would cost more than they save, and fuse operations."""
    import llvmlite.binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    try:
        features = llvm.get_host_cpu_features().flatten()
    except RuntimeError:  # not known on every platform
        features = ""
    machine = llvm.Target.from_default_triple().create_target_machine(
        cpu=llvm.get_host_cpu_name(), features=features, opt=level
    )
    module = llvm.parse_assembly(text)
    module.verify()
    engine = llvm.create_mcjit_compiler(module, machine)
    engine.finalize_object()
    address = int(engine.get_function_address(name))
    engine.remove_module(module)  # it is as large as the machine code, which the engine keeps
    module.close()
    return engine, address
