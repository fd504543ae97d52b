"""What a robot that drives looks like from above, with a nose, so that its heading is seen."""

import numpy as np

NOSE = 0.12  # of the box's length, how far the nose stands out
CHEEK = 0.35  # of the box's width, from either side to the nose
BODY, LONG, TYRE = 0.36, 0.45, 0.07  # of the track: half the body's width and length, half a tyre's width
CUT = 0.14  # of the track, off the body's corners


def box_with_nose(low: tuple[float, float], high: tuple[float, float]) -> np.ndarray:
    """(7, 2) m: the box from `low` to `high` (x forward, y left), m, with a nose in front."""
    (back, right), (front, left) = low, high
    tip, cheek = front + NOSE * (front - back), CHEEK * (left - right)
    middle = 0.5 * (left + right)
    nose = [(front, right + cheek), (tip, middle), (front, left - cheek)]
    return np.array([*nose, (front, left), (back, left), (back, right), (front, right)])


def two_wheels(track: float, radius: float) -> np.ndarray:
    """(P, 2) m: a body with cut corners between two wheels that stand `track` m apart, their axle at the origin."""
    front, side, cut = LONG * track, BODY * track, CUT * track
    inner, outer = (0.5 - TYRE) * track, (0.5 + TYRE) * track
    tip = front + NOSE * track
    left = [(tip, 0.0), (front, 0.25 * side), (front, side - cut), (front - cut, side)]
    left += [(0.3 * radius, side), (0.3 * radius, inner), (radius, inner), (radius, outer)]
    left += [(-radius, outer), (-radius, inner), (-0.3 * radius, inner), (-0.3 * radius, side)]
    left += [(cut - front, side), (-front, side - cut)]
    return np.array([*left, *[(x, -y) for x, y in left[:0:-1]]])
