"""Kinks rounded off for optimisers that converge: real-time iteration does not need it, IPOPT and its like do."""

from dataclasses import replace

from residual_mpc.effects.ops import Array, Kinks, Ops


def smoothed(ops: Ops, width: float) -> Ops:
    """The table with |x| as sqrt(x^2 + width^2) and what follows from it; width in the unit of the signal.

    |x| is at most `width` off, a minimum or maximum half of that, each at its kink; sgn(x) is x / |x|.
    """

    def absolute(x: Array) -> Array:
        return (x * x + width * width) ** 0.5

    return replace(
        ops,
        minimum=lambda a, b: 0.5 * (a + b - absolute(a - b)),
        maximum=lambda a, b: 0.5 * (a + b + absolute(a - b)),
        absolute=absolute,
        sign=lambda x: x / absolute(x),
    )


def kinks(ops: Ops, width: float) -> Kinks:
    """How signals see their kinks: exactly (width 0), or rounded by `width` command units."""
    if width == 0.0:
        return Kinks(ops, lambda scale: ops, 0.0)
    return Kinks(ops, lambda scale: smoothed(ops, width * scale), width)
