"""At which window a change began, by maximum likelihood."""

from __future__ import annotations

import numpy as np


def change_point(scores: np.ndarray) -> int:
    """The index of the first window after the change, for scores (W,) that are larger after it; NaN where a window has
    none.

    Before the change the scores are standard normal; after it they have another mean, whose maximum-likelihood estimate
    is their own. The generalised likelihood ratio of a change before window k is then (sum of the scores from k on)^2 /
    (2 (W - k)) (Basseville and Nikiforov 1993, section 2.4.3).
    """
    known = np.isfinite(scores)
    after = np.maximum(np.cumsum(np.where(known, scores, 0.0)[::-1])[::-1], 0.0)
    count = np.cumsum(known[::-1])[::-1]
    return int(np.argmax(after**2 / np.maximum(count, 1)))
