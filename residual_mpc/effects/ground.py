"""The motion of a wheeled base over the ground, with the effects between the two."""

from collections.abc import Sequence

from residual_mpc.effects.library import Effects, changes, fitted_laws, present
from residual_mpc.effects.ops import Array, Ops


def ground_twist(
    ops: Ops,
    effects: Effects,
    wheel_radius: Array,
    track_width: Array,
    w: tuple[Array, Array],
    a: tuple[Array, Array],
    roundness: tuple[Array | None, Array | None] = (None, None),
) -> tuple[Array, Array, Array]:
    """Body-frame velocity of a differential drive (paper, the equation labelled wheel_prop) with the contact
    effects.

    w: wheel speeds left, right, rad/s; a: their accelerations, rad/s^2; roundness: factors on their radii (see
    `radius_factor`), None for 1.
    Returns forward m/s, sideways (to the left) m/s, yaw rate rad/s. Effects at other sites are not looked at.
    """
    both, right, width = (changes(effects, q) for q in ("wheel radius", "right wheel radius", "track width"))
    r_left = wheel_radius if both is None else wheel_radius * both
    r_right = r_left if right is None else r_left * right
    r_left, r_right = (r if f is None else r * f for r, f in zip((r_left, r_right), roundness, strict=True))
    rims = [r_left * w[0], r_right * w[1]]
    for effect, p in present(effects, "rim"):
        assert effect.step is not None
        rims = [effect.step(ops, p, v, r * acc) for v, r, acc in zip(rims, (r_left, r_right), a, strict=True)]
    track = track_width if width is None else track_width * width
    forward = 0.5 * (rims[0] + rims[1])
    yaw = (rims[1] - rims[0]) / track
    sideways: Array | None = None
    for effect, p in present(effects, "side"):
        assert effect.step is not None
        more = effect.step(ops, p, forward, yaw)
        sideways = more if sideways is None else sideways + more
    return forward, 0.0 * forward if sideways is None else sideways, yaw


def radius_factor(ops: Ops, effects: Effects, angle: Array) -> Array | None:
    """What the effects of one wheel multiply its radius by at its angle, rad; None where none does."""
    total: Array | None = None
    for effect, p in present(effects, "roundness"):
        assert effect.step is not None
        factor = effect.step(ops, p, angle)
        total = factor if total is None else total * factor
    return total


def with_fitted_rates(
    ops: Ops, rates: tuple[Array, Array, Array], laws: Sequence[Effects]
) -> tuple[Array, Array, Array]:
    """The base's own rates (forward m/s, sideways m/s, yaw rad/s) with what fitted laws of them add; laws: of each."""
    if not any(laws):
        return rates
    signals = {"forward": rates[0], "turning": rates[2]}
    added = [fitted_laws(ops, law, "rate", signals) for law in laws]
    forward, sideways, yaw = (r if a is None else r + a for r, a in zip(rates, added, strict=True))
    return forward, sideways, yaw


def world_drift(ops: Ops, effects: Effects) -> tuple[Array, Array] | None:
    """World-frame velocity (m/s, m/s) that the effects add to the base; None where none does."""
    total: tuple[Array, Array] | None = None
    for effect, p in present(effects, "drift"):
        assert effect.step is not None
        x, y = effect.step(ops, p)
        total = (x, y) if total is None else (total[0] + x, total[1] + y)
    return total
