"""A value that follows another no faster than a limit lets it, in steps over which the other is held."""

from residual_mpc.effects.ops import Array, Ops, clip

TINY = 1e-300  # keeps the mean defined for a limit of 0, where it is exactly the beginning


def missing(ops: Ops, away: Array, most: Array) -> tuple[Array, Array]:
    """What is missing to the other value, in the mean over a step and at its end. At an infinite limit it is 0.

    The value moves evenly, and stands still once it has arrived: with the way m = clip(away, +-most), it is missing
    away - m at the end, and away - m + m |m| / (2 most) in the mean.

    Args:
        away: of the other value less this one at the beginning of the step.
        most: by which this one may move in a step.
    """
    way = clip(ops, away, -most, most)
    end = away - way
    return end + way * ops.absolute(way) / (2.0 * ops.maximum(most, TINY)), end


def missing_at_end(ops: Ops, mean: Array, most: Array) -> Array:
    """What is missing at the end of a step in which `mean` of it is missing in the mean."""
    half = 0.5 * most
    return mean - clip(ops, mean, -half, half)
