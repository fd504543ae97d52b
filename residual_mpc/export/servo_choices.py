"""The numbers of servos over several diagnoses of one robot, each from another choice of motions."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import sqrt
from statistics import fmean, stdev

from residual_mpc.models.servo_table import CORRECTED, ServoRow


@dataclass(frozen=True)
class Across:
    """One number over all diagnoses. value: mean of those in which an effect on it is named, with the 95 % interval
    of that mean, by the spread between the choices alone; None where fewer than two name one. named: in how many."""

    value: float | None
    ci95: tuple[float, float] | None
    named: int
    of: int


def across(tables: Sequence[Sequence[ServoRow]]) -> Mapping[tuple[str, str], Across]:
    """(actuator, number) -> what the diagnoses say together.

    The mean of the estimates with Student's t of their standard deviation: each choice of motions has errors of its own
    that its interval does not contain, so that the diagnoses count alike, as in a random-effects analysis whose spread
    between studies is much larger than that within them (Hartung and Knapp, Statistics in Medicine 20, 2001, eq. 4).
    """
    found: dict[tuple[str, str], list[float]] = {}
    for rows in tables:
        for row in rows:
            for v in row.values:
                values = found.setdefault((row.actuator, v.name), [])
                if v.status == CORRECTED and v.value is not None:
                    values.append(v.value)
    return {key: _mean(values, len(tables)) for key, values in found.items()}


def _mean(values: Sequence[float], of: int) -> Across:
    from scipy.special import stdtrit  # slow to import

    n = len(values)
    if n < 2:
        return Across(None, None, n, of)
    mean = fmean(values)
    half = float(stdtrit(n - 1, 0.975)) * stdev(values) / sqrt(n)
    return Across(mean, (mean - half, mean + half), n, of)
