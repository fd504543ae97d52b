"""The score of what a remainder depends on."""

from benchmarks.unknowns import RIGHT, laws, right
from plants.blind_families.arm.family import HABITS as ARM
from plants.blind_families.wheeled.family import HABITS as WHEELED


def test_every_unnamed_cause_has_its_dependence() -> None:
    drawn = (*ARM.unnamed, *ARM.unnamed_in_tests, *WHEELED.unnamed, *WHEELED.unnamed_in_tests)
    assert set(RIGHT) == set(drawn)


def test_the_first_named_counts_and_silence_where_there_is_nothing_to_say() -> None:
    assert right("dented_tooth", ["angle", "time"]) and not right("dented_tooth", ["time", "angle"])
    assert right("gusts", []) and not right("gusts", ["time"]) and not right("dented_tooth", [])


def test_laws_are_told_by_what_they_are_of() -> None:
    law = {"effect": "fitted_law"}
    assert laws([{**law, "on": "the angle of j2"}, {"effect": "actuator_gain"}]) == ["angle"]
    assert laws([{**law, "on": "the size of the load on j2"}, {"effect": "joint_spring"}]) == ["load", "position"]
    assert laws([{**law, "on": "the time in the run"}, {**law, "on": "the turning rate"}]) == ["time", "turning"]
