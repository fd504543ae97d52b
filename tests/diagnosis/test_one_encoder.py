"""A scale and a bias of one encoder over a small part of a turn may be an encoder off its axis."""

from residual_mpc.diagnosis.results.one_encoder import encoder_notes, of_one_encoder
from residual_mpc.models.settings import Term

SCALE, BIAS = (Term(f"sensor_{kind}", "position.j1") for kind in ("scale", "bias"))
OTHER, UNSHOWN = Term("sensor_bias", "position.j2"), Term("encoder_eccentricity", "position.j1")


def test_only_both_on_a_channel_that_does_not_show_it() -> None:
    assert of_one_encoder((SCALE, OTHER, BIAS), [UNSHOWN]) == (SCALE, BIAS)
    assert of_one_encoder((SCALE, OTHER), [UNSHOWN]) == () and of_one_encoder((SCALE, BIAS), []) == ()
    assert of_one_encoder((SCALE, BIAS), [Term("encoder_eccentricity", "position.j2")]) == ()


def test_each_channel_has_its_note() -> None:
    (note,) = encoder_notes((SCALE, OTHER, BIAS), [UNSHOWN])
    assert "The scale and the bias of position.j1" in note and "off its axis" in note
    assert encoder_notes((SCALE, OTHER), [UNSHOWN]) == ()
