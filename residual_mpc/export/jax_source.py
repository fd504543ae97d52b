"""The step as plain JAX source, operation by operation from CasADi's own list: a file that needs nothing but JAX."""

from typing import Any

from residual_mpc.errors import BadInput
from residual_mpc.export.casadi_model import CasadiModel

HEAD = '''"""{title}

x_next = step(x, u, p): x ({nx},) {x_names}
u ({nu},) {u_names}
p ({np},): PARAMETERS holds the values of the diagnosis, PARAMETER_NAMES their names. dt = {dt!r} s.
Written by residual-mpc export. For the source's digits: jax.config.update("jax_enable_x64", True).
"""

import jax.numpy as jnp

STATE_NAMES = {x_names!r}
COMMAND_NAMES = {u_names!r}
PARAMETER_NAMES = {p_names!r}
PARAMETERS = {p0!r}
REST = {rest!r}


'''


def jax_source(model: CasadiModel, title: str, rest: list[float]) -> str:
    """Python source of a module with `step`. Raises BadInput for an operation that this writer does not know."""
    head = HEAD.format(
        title=title,
        nx=len(model.x_names),
        nu=len(model.u_names),
        np=len(model.p_names),
        x_names=model.x_names,
        u_names=model.u_names,
        p_names=model.p_names,
        p0=[float(v) for v in model.p0],
        rest=rest,
        dt=model.dt,
    )
    text = head + _function("step(x, u, p)", "The state one sample later.", model.f)
    if model.y is not None:
        import casadi as ca

        output = ca.Function("output", [model.x], [model.y])
        text += "\n\n" + _function("output(x)", f"What is tracked: {', '.join(model.y_names)}.", output)
    return text


def _function(head: str, title: str, f: Any) -> str:
    """Source of f, whose one output is an (n,) array."""
    lines = "\n".join("    " + _line(f, k) for k in range(f.n_instructions()))
    # an entry that is structurally zero is not in the list of operations
    rows = list(f.sparsity_out(0).row())
    full = ", ".join(f"o{rows.index(i)}" if i in rows else "0.0 * x[0]" for i in range(f.size1_out(0)))
    return f'def {head}:\n    """{title}"""\n{lines}\n    return jnp.stack([{full}])\n'


def _line(f: Any, k: int) -> str:
    import casadi as ca

    op, o, i = f.instruction_id(k), f.instruction_output(k), f.instruction_input(k)
    names = ("x", "u", "p")
    a = f"w{i[0]}" if i else ""
    b = f"w{i[1]}" if len(i) > 1 else ""
    if op == ca.OP_CONST:
        return f"w{o[0]} = {f.instruction_constant(k)!r}"
    if op == ca.OP_INPUT:
        return f"w{o[0]} = {names[i[0]]}[{i[1]}]"
    if op == ca.OP_OUTPUT:
        return f"o{o[1]} = {a}"
    patterns = {
        ca.OP_ASSIGN: f"{a}",
        ca.OP_ADD: f"{a} + {b}",
        ca.OP_SUB: f"{a} - {b}",
        ca.OP_MUL: f"{a} * {b}",
        ca.OP_DIV: f"{a} / {b}",
        ca.OP_NEG: f"-{a}",
        ca.OP_SQ: f"{a} * {a}",
        ca.OP_TWICE: f"2.0 * {a}",
        ca.OP_INV: f"1.0 / {a}",
        ca.OP_SQRT: f"jnp.sqrt({a})",
        ca.OP_POW: f"{a} ** {b}",
        ca.OP_CONSTPOW: f"{a} ** {b}",
        ca.OP_EXP: f"jnp.exp({a})",
        ca.OP_SIN: f"jnp.sin({a})",
        ca.OP_COS: f"jnp.cos({a})",
        ca.OP_ATAN2: f"jnp.arctan2({a}, {b})",
        ca.OP_AND: f"{a} * {b}",
        ca.OP_TANH: f"jnp.tanh({a})",
        ca.OP_FABS: f"jnp.abs({a})",
        ca.OP_SIGN: f"jnp.sign({a})",
        ca.OP_FMIN: f"jnp.minimum({a}, {b})",
        ca.OP_FMAX: f"jnp.maximum({a}, {b})",
        ca.OP_LT: f"({a} < {b}) * 1.0",
        ca.OP_LE: f"({a} <= {b}) * 1.0",
        ca.OP_NOT: f"1.0 - {a}",
        ca.OP_IF_ELSE_ZERO: f"jnp.where({a} != 0.0, {b}, 0.0)",
    }
    if op not in patterns:
        raise BadInput(
            f"CasADi operation {op} is not supported in the JAX export", "export", "export to casadi or c instead"
        )
    return f"w{o[0]} = {patterns[op]}"
