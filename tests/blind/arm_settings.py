"""Arms that tests of hidden robots share, since to draw one takes seconds."""

from functools import cache

import numpy as np

from plants.blind_families.arm.setting import Setting, draw_setting
from residual_mpc.blind.levels import LEVELS


@cache
def single_arm(seed: int) -> Setting:
    """What a case of one effect is made of."""
    setting = draw_setting(LEVELS["single"], np.random.default_rng(seed))
    assert setting is not None
    return setting
