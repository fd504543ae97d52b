"""What a robot that drives looks like from above: a box with a nose, so that its heading is seen."""

import numpy as np

NOSE = 0.12  # of the box's length, how far the nose stands out
CHEEK = 0.35  # of the box's width, from either side to the nose


def box_with_nose(low: tuple[float, float], high: tuple[float, float]) -> np.ndarray:
    """(7, 2) m: the box from `low` to `high` (x forward, y left), m, with a nose in front."""
    (back, right), (front, left) = low, high
    tip, cheek = front + NOSE * (front - back), CHEEK * (left - right)
    middle = 0.5 * (left + right)
    nose = [(front, right + cheek), (tip, middle), (front, left - cheek)]
    return np.array([*nose, (front, left), (back, left), (back, right), (front, right)])
