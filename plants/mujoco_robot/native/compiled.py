"""A program in machine code: many steps of many rows, as a function of arrays."""

from __future__ import annotations

from collections.abc import Callable
from ctypes import CFUNCTYPE, c_int64, c_void_p
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from plants.mujoco_robot.native.lanes import LANES, Program
from plants.mujoco_robot.native.step import Chain, sizes, trace


@dataclass(frozen=True, eq=False)
class Rollout:
    """What the steps of some rows work on, for whole blocks of LANES rows; the arrays are C-contiguous.

    numbers (blocks, sizes, LANES); state (blocks, 3 n, LANES): positions, velocities and accelerations, gone on with in
    place; controls (rows, steps, nu); positions, velocities (rows, steps + 1, n): written from the second node on;
    forces (blocks, nu, LANES): of the last step; failed (blocks, 1, LANES): 1 where a step is not exact.
    """

    numbers: np.ndarray
    state: np.ndarray
    controls: np.ndarray
    positions: np.ndarray
    velocities: np.ndarray
    forces: np.ndarray
    failed: np.ndarray


class Compiled:
    """The machine code of a chain's steps."""

    def __init__(self, chain: Chain) -> None:
        self._roll = _function(text_of(chain))

    def __call__(self, on: Rollout, begin: int, end: int, each: int) -> None:
        """Steps begin to end - 1, each of so many of the model's."""
        (_, steps, nu), n = on.controls.shape, on.positions.shape[2]
        arrays = (on.numbers, on.state, on.controls, on.positions, on.velocities, on.forces, on.failed)
        skipped = (0, 0, begin * nu, (begin + 1) * n, (begin + 1) * n, 0, 0)
        places = [a.ctypes.data + a.itemsize * k for a, k in zip(arrays, skipped, strict=True)]
        self._roll(*places, len(on.state), end - begin, each, steps * nu, (steps + 1) * n)


def text_of(chain: Chain) -> str:
    """The program in LLVM's language: the arrays of Rollout, then the numbers of blocks, of steps and of the model's
    steps in each, and the sizes of a row in controls and in positions."""
    from llvmlite import ir

    double, whole = ir.DoubleType(), ir.IntType(64)
    vector = ir.VectorType(double, LANES)
    vectors, plain = vector.as_pointer(), double.as_pointer()
    arrays = [vectors, vectors, plain, plain, plain, vectors, vectors]
    module = ir.Module("arm")
    function = ir.Function(module, ir.FunctionType(ir.VoidType(), [*arrays, *[whole] * 5]), "roll")
    for argument in function.args[: len(arrays)]:
        argument.add_attribute("noalias")
    numbers, state, controls, positions, velocities, forces, failed, *counts = function.args
    blocks, steps, each, sent_size, node_size = counts
    n, nu = len(chain.joints), len(chain.actuators)
    builder = ir.IRBuilder(function.append_basic_block("entry"))
    program = Program(builder, double)
    held = program.memory(vector, max(nu, 1))

    def at(array: Any, index: Any, size: Any) -> Any:
        return builder.gep(array, [builder.mul(index, size if not isinstance(size, int) else ir.Constant(whole, size))])

    def block(b: Any) -> None:
        mine, row = at(state, b, 3 * n), at(numbers, b, sizes(chain))
        force, wrong = at(forces, b, nu), at(failed, b, 1)
        first = builder.mul(b, ir.Constant(whole, LANES))

        def rows(array: Any, size: Any) -> list[Any]:
            return [at(array, builder.add(first, ir.Constant(whole, lane)), size) for lane in range(LANES)]

        sent, places, rates = rows(controls, sent_size), rows(positions, node_size), rows(velocities, node_size)

        def one(k: Any) -> None:
            for i, u in enumerate(program.gather([at(s, k, nu) for s in sent], nu)):
                program.store(u, held, i)
            _loop(builder, each, lambda j: trace(program, chain, row, mine, held, force, wrong))
            for array, begin in ((places, 0), (rates, n)):
                to = [at(a, k, n) for a in array]
                for i in range(n):
                    program.scatter(program.load(mine, begin + i), to, i)

        _loop(builder, steps, one)

    _loop(builder, blocks, block)
    builder.ret_void()
    return str(module)


def _loop(builder: Any, count: Any, body: Callable[[Any], None]) -> None:
    """body(number) so many times."""
    from llvmlite import ir

    whole = count.type
    head, inside, end = (builder.append_basic_block(x) for x in ("head", "inside", "end"))
    begin = builder.block
    builder.branch(head)
    builder.position_at_end(head)
    k = builder.phi(whole)
    k.add_incoming(ir.Constant(whole, 0), begin)
    builder.cbranch(builder.icmp_signed("<", k, count), inside, end)
    builder.position_at_end(inside)
    body(k)
    k.add_incoming(builder.add(k, ir.Constant(whole, 1)), builder.block)
    builder.branch(head)
    builder.position_at_end(end)


@cache
def _function(text: str) -> Any:
    """The compiled program, for this processor; kept as long as the process lives."""
    import llvmlite.binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    machine = llvm.Target.from_default_triple().create_target_machine(
        cpu=llvm.get_host_cpu_name(), features=llvm.get_host_cpu_features().flatten(), opt=2
    )
    module = llvm.parse_assembly(text)
    module.verify()
    # level 1 removes repeated products; more takes longer than it saves
    passes = llvm.create_pass_builder(machine, llvm.create_pipeline_tuning_options(speed_level=1))
    passes.getModulePassManager().run(module, passes)
    engine = llvm.create_mcjit_compiler(module, machine)
    engine.finalize_object()
    kind = CFUNCTYPE(None, *[c_void_p] * 7, *[c_int64] * 5)
    function = kind(engine.get_function_address("roll"))
    function.engine = engine  # type: ignore[attr-defined]  # which owns the code
    return function
