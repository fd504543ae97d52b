"""A base controller as it really is: it decides on a forward speed and a rate of turn for both wheels together."""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, inf

_GIVE_TIME = 0.03  # s in which the wheels' loops give way to the ground
_KNEE = 14  # the larger, the sharper a limit begins


@dataclass(frozen=True)
class Steering:
    """Constants of the controller; the defaults pass both wheels' speeds on."""

    turn: float = 1.0  # share of the commanded difference that the wheels keep
    most_turn: float = inf  # rad/s, of half the difference
    most_speed: float = inf  # rad/s, of the faster wheel; the other one slows down with it

    @property
    def idle(self) -> bool:
        return self == Steering()


class BaseController:
    """A leaf with explicit memory, one instance a run."""

    def __init__(self) -> None:
        self.lost = 0.0  # rad/s, of half the difference

    def __call__(self, steering: Steering, left: float, right: float, dt: float) -> tuple[float, float]:
        """Wheel speeds, rad/s, from those of a command that is held for dt s."""
        forward, turn = 0.5 * (left + right), 0.5 * (right - left)
        self.lost += (turn * (1.0 - steering.turn) - self.lost) * (1.0 - exp(-dt / _GIVE_TIME))
        turn = _soft(turn - self.lost, steering.most_turn)
        fastest = abs(forward) + abs(turn)
        share = _soft(fastest, steering.most_speed) / fastest if fastest > 0.0 else 1.0
        return share * (forward - turn), share * (forward + turn)


def _soft(value: float, limit: float) -> float:
    """The value behind a limit that begins softly."""
    return value if limit == inf else value / (1.0 + (abs(value) / limit) ** _KNEE) ** (1.0 / _KNEE)
