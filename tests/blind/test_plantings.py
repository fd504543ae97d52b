"""The records of planted effects: in the library's words, and in agreement with what it knows of twins."""

import numpy as np
import pytest
from arm_settings import single_arm

from plants.blind_families.arm.effects import LONG_PLANTINGS as LONG_ARM
from plants.blind_families.arm.effects import PLANTINGS as ARM
from plants.blind_families.arm.family import ArmBench
from plants.blind_families.planting import Faint, background, clash, confounded
from plants.blind_families.scaler.effects import PLANTINGS as SCALER
from plants.blind_families.wheeled.effects import EVERY as EVERY_WHEELED
from plants.blind_families.wheeled.effects import PLANTINGS as WHEELED
from plants.blind_families.wheeled.family import WheeledBench
from plants.blind_families.wheeled.setting import draw_setting as draw_wheeled
from residual_mpc.blind.levels import LEVELS
from residual_mpc.effects.equivalents import inseparable_from
from residual_mpc.effects.library import BY_NAME


@pytest.mark.parametrize("effect", sorted(EVERY_WHEELED))
def test_a_wheeled_effect_is_planted_with_the_parameters_of_the_library(effect):
    rng = np.random.default_rng(4)
    bench = WheeledBench(draw_wheeled(LEVELS["single"], (effect,), False, rng), (effect,), False)
    _, parameters = bench.plant(bench.robot, bench.draw(effect, rng), 0.3)
    assert set(parameters) == {p.name for p in BY_NAME[effect].parameters if not p.optional}


@pytest.fixture(scope="module")
def arm_setting():
    return single_arm(5)


@pytest.mark.parametrize("effect", sorted({**ARM, **LONG_ARM}))
def test_an_arms_effect_is_planted_with_the_parameters_of_the_library(effect, arm_setting):
    bench = ArmBench(arm_setting, (effect,), known=LONG_ARM if effect in LONG_ARM else ARM)
    _, parameters = bench.plant(bench.robot, bench.draw(effect, np.random.default_rng(5)), 0.3)
    assert set(parameters) == {p.name for p in BY_NAME[effect].parameters if not p.optional}


@pytest.mark.parametrize(
    ("plantings", "traits"),
    [(WHEELED, ("wheeled", "no_encoders")), (ARM, ("arm", "no_drops")), (SCALER, ("arm", "no_drops"))],
)
def test_what_a_confounded_case_plants_has_a_twin(plantings, traits):
    ways = confounded(plantings)
    assert ways
    for name, way in ways.items():
        straight = ("straight",) if way.straight else ()
        planted = way.by.name if way.by else name
        assert inseparable_from(planted, (*traits, *straight))
        if planted != name:
            assert name in inseparable_from(planted, (*traits, *straight))


def test_two_of_a_group_clash_and_two_of_different_groups_do_not():
    assert clash(WHEELED, ("wheel_radius", "voltage_sag")) and not clash(WHEELED, ("wheel_radius", "slope"))
    assert clash(ARM, ("link_length", "payload")) and not clash(ARM, ("link_length", "armature"))
    late = ("armature", "command_delay")
    assert clash(SCALER, late) and not clash(ARM, late)


def test_the_background_leaves_out_the_strong_effects_what_clashes_and_what_is_never_faint():
    rubbing = background(ARM, ("stribeck_friction",))
    assert "coulomb_friction" not in rubbing and "viscous_friction" in rubbing
    assert "coulomb_friction" in background(ARM, ("payload",)) and "payload" not in background(ARM, ("payload",))
    for plantings in (WHEELED, ARM, SCALER):
        never = {name for name, p in plantings.items() if p.faint is Faint.NONE}
        assert never and not never & set(background(plantings, ()))
