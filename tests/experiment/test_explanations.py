"""Which explanations of a diagnosis a plan has to tell apart."""

from plants.diff_drive import DiffDrive
from residual_mpc.experiment.explanations import explanations_of

ROBOT = DiffDrive("rover", 0.05, 0.2)


def effects(*names):
    return [{"effect": name, "target": None} for name in names]


def values(**numbers):
    parameters = {"command_delay": "delay", "sensor_delay": "delay", "track_width": "scale"}
    return [{"effect": k, "target": None, "parameter": parameters[k], "value": v} for k, v in numbers.items()]


DOCUMENT = {
    "robot": "rover",
    "explanation": effects("command_delay"),
    "model": {"values": values(command_delay=0.05)},
    "alternatives": [
        {
            "effects": effects("sensor_delay"),
            "instead_of": effects("command_delay"),
            "values": values(sensor_delay=0.05),
        },
        {"effects": effects("track_width"), "instead_of": effects("command_delay"), "values": values(track_width=1.1)},
        {
            "effects": effects("sensor_delay", "track_width"),
            "instead_of": effects("slope"),
            "values": values(sensor_delay=0.05, track_width=1.1),
        },
    ],
}


EVERY = ["command_delay", "sensor_delay", "track_width", "sensor_delay + track_width"]


def names(parts=()):
    return [e.name for e in explanations_of(DOCUMENT, ROBOT, "diagnosis.json", parts)]


def test_all_alternatives_where_nothing_is_asked_for():
    assert names() == EVERY


def test_the_alternatives_of_what_is_to_be_told_apart_alone():
    assert names(["command_delay", "sensor_delay"]) == ["command_delay", "sensor_delay"]


def test_all_where_none_of_the_alternatives_is_asked_for():
    assert names(["payload", "armature"]) == EVERY


def test_those_that_only_came_in_place_of_others_where_no_other_is_asked_for():
    assert names(["track_width", "payload"]) == ["command_delay", "track_width", "sensor_delay + track_width"]
