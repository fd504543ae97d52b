"""The levels of the benchmark: how many effects a case has, how rough its log is, and what else is wrong.

What is right follows from the answer that a case of the level has (see ``score.match``).
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Level:
    """One level: a recipe that every family follows."""

    name: str
    effects: tuple[int, int]  # least and most number of strong effects
    background: float = 0.0  # strength of every other effect, as a share of a strong one
    rough: bool = False  # feedback motion, jitter, dropouts, coloured noise, quantisation
    noise: float = 1.0  # factor on the sensor noise
    unknown: bool = False  # one cause that no library names, in place of effects
    withheld: bool = False  # the candidate of the planted effect is taken away
    confounded: bool = False  # effects and runs are chosen so that a group is the right answer
    wild: bool = False  # robots of all sizes, logs of all rates, late stamps, lost samples, rare outliers
    pairs: bool = False  # two effects that are easily mistaken for each other
    changed: bool = False  # the effect begins or ends in the middle of the runs, or differs between them
    slow: bool = False  # effects under the noise over one second, above it over ten
    long: bool = False  # an effect that many seconds or many turns of a wheel show
    base: bool = False  # an effect of what decides on both wheels' speeds together
    servo: bool = False  # an effect of servos, springs, stops or the mounting
    misspecified: bool = False  # the model is wrong in ways that no library names, beside the effects
    ratio: tuple[float, float] = (2.5, 18.0)  # least and most gap that one effect adds, over the noise floor
    rest: tuple[float, float] = (0.0, 0.0)  # the same of what no set of constant effects explains

    @property
    def wanted(self) -> tuple[float, float]:
        """The ratios that strengths are tuned to, well inside ``ratio``."""
        return 1.4 * self.ratio[0], self.ratio[1] * 13 / 18


LEVELS: dict[str, Level] = {
    level.name: level
    for level in (
        Level("single", (1, 1)),
        Level("double", (2, 2)),
        Level("hard", (2, 3), background=0.1, rough=True),
        Level("none", (0, 0)),
        Level("noisy_none", (0, 0), noise=4.0),
        Level("unknown", (0, 0), unknown=True),
        Level("withheld", (1, 1), withheld=True),
        Level("confounded", (1, 1), confounded=True),
        Level("rough_none", (0, 0), wild=True),
        Level("confusable", (2, 2), pairs=True),
        Level("changed", (1, 1), changed=True, ratio=(6.0, 40.0), rest=(2.5, 30.0)),
        Level("slow", (1, 2), slow=True, ratio=(3.0, 15.0)),
        Level("servo", (1, 1), servo=True),
        Level("long", (1, 1), long=True),
        Level("base", (1, 1), base=True),
        Level("misspecified", (1, 2), misspecified=True, ratio=(4.0, 50.0), rest=(5.0, 30.0)),
    )
}
