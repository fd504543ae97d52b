"""A scale and a bias of one encoder that may together be another fault: an encoder off its axis reads so over a small
part of a turn."""

from collections.abc import Collection, Sequence

from residual_mpc.effects.sensor import ENCODER_ECCENTRICITY, SENSOR_BIAS, SENSOR_SCALE
from residual_mpc.models.settings import Term


def of_one_encoder(terms: Sequence[Term], untested: Collection[Term]) -> tuple[Term, ...]:
    """The scales and biases that are named together on a channel whose eccentricity these runs cannot show."""
    both = {SENSOR_SCALE.name, SENSOR_BIAS.name}
    found = []
    for term in terms:
        here = {t.effect for t in terms if t.target == term.target}
        if term.effect in both <= here and Term(ENCODER_ECCENTRICITY.name, term.target) in untested:
            found.append(term)
    return tuple(found)


def encoder_notes(terms: Sequence[Term], untested: Collection[Term]) -> tuple[str, ...]:
    """A sentence on each channel with such a pair."""
    channels = dict.fromkeys(str(t.target) for t in of_one_encoder(terms, untested))
    return tuple(
        f"The scale and the bias of {channel} may together be an encoder off its axis, which reads alike over so small "
        "a part of a turn: turn the joint farther."
        for channel in channels
    )
