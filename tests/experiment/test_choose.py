"""What more than a motion is asked for, and when."""

from dataclasses import replace

import numpy as np
import pytest

from plants.diff_drive import DiffDrive
from residual_mpc.experiment import choose as choose_module
from residual_mpc.experiment.choose import PARTS, choose
from residual_mpc.experiment.drive_setup import DriveSetup
from residual_mpc.experiment.separate import Planned, Separation

ROBOT = DiffDrive("rover", 0.05, 0.2)
ONE = np.ones(1)
ARM = DriveSetup(("j1",), -ONE, ONE, 0 * ONE, 0.02, {"position.j1": 1e-3}, {"position.j1": 0.0})
ROVER = DriveSetup(("left", "right"), -np.ones(2), np.ones(2), np.zeros(2), 0.02, {"pose.x": 1e-3}, {"pose.x": 0.0})


def chosen(bench, monkeypatch, ratio):
    """ratio: of a motion, by whether encoders are logged and motors switched off."""

    def losses(bench, motion):
        told = ratio("velocity.left" in bench.sigma, motion.enabled is not None)
        return np.array([[np.inf, told], [told, np.inf]])

    return chosen_by(bench, monkeypatch, losses)


def chosen_by(bench, monkeypatch, losses):
    """losses: of a motion on a bench, (n, n)."""

    def separation(robot, bench, motion, explanations, rng):
        return Separation(Planned(motion, True), losses(bench, motion))

    monkeypatch.setattr(choose_module, "separation", separation)
    return choose(ROBOT, bench, ({}, {}, {}), 20.0, np.random.default_rng(0))


def test_a_motion_alone_will_do(monkeypatch):
    for bench in (ARM, ROVER):
        found = chosen(bench, monkeypatch, lambda encoders, off: 2 * PARTS)
        assert found.parts and not found.sensors and not found.switches


def test_two_motions_where_each_parts_another_pair(monkeypatch):
    """A first explanation against two others: spins part one, straights the other."""

    def losses(bench, motion):
        first = 100.0 if "spins" in motion.name else 1.0
        second = 100.0 if "straight" in motion.name else 1.0
        out = np.full((3, 3), 100.0)
        out[0, 1] = out[1, 0] = first
        out[0, 2] = out[2, 0] = second
        return out + np.diag([np.inf] * 3)

    found = chosen_by(ROVER, monkeypatch, losses)
    names = {s.planned.motion.name for s in found.played}
    assert names == {"spins to both sides", "straight both ways at two headings"} and not found.sensors
    assert found.parts and found.ratio == 101.0


def test_a_pair_that_no_motion_parts_does_not_choose_the_motion(monkeypatch):
    """The third explanation is the second in other words: straights part both from the first, spins none."""

    def losses(bench, motion):
        out = np.full((3, 3), 100.0 if "straight" in motion.name else 1.0)
        out[1, 2] = out[2, 1] = 0.0 if "straight" in motion.name else 0.1  # noise
        return out + np.diag([np.inf] * 3)

    found = chosen_by(ROVER, monkeypatch, losses)
    assert [s.planned.motion.name for s in found.played] == ["straight both ways at two headings"]
    assert not found.parts and not found.sensors


def of_pairs(first, second, third):
    """Losses of three explanations, one number a pair."""
    out = np.full((3, 3), np.inf)
    out[0, 1] = out[1, 0] = first
    out[0, 2] = out[2, 0] = second
    out[1, 2] = out[2, 1] = third
    return out


def test_among_motions_that_part_the_same_pairs_the_noise_of_another_pair_does_not_decide(monkeypatch):
    def losses(bench, motion):
        return of_pairs(100.0, 100.0, 0.0) if "straight" in motion.name else of_pairs(15.0, 15.0, 6.0)

    found = chosen_by(ROVER, monkeypatch, losses)
    assert [s.planned.motion.name for s in found.played] == ["straight both ways at two headings"]


def test_of_motions_in_vain_the_nearest_is_taken(monkeypatch):
    found = chosen_by(ROVER, monkeypatch, lambda _, m: of_pairs(*[0.2 * PARTS * (1 + ("steps" in m.name))] * 3))
    assert found.played[0].planned.motion.name.startswith("steps")


@pytest.mark.parametrize(
    ("motion", "encoders"),
    [
        (of_pairs(0.1, 0.1, 0.1), of_pairs(0.12, 0.12, 0.12)),
        (of_pairs(100.0, 100.0, 0.0), of_pairs(100.0, 100.0, 0.01)),
        (of_pairs(0.9 * PARTS, 100.0, 100.0), of_pairs(1.1 * PARTS, 100.0, 100.0)),
    ],
)
def test_encoders_that_hardly_tell_more_are_not_asked_for(monkeypatch, motion, encoders):
    found = chosen_by(ROVER, monkeypatch, lambda bench, _: encoders if "velocity.left" in bench.sigma else motion)
    assert not found.sensors


def test_encoders_are_not_asked_for_by_one_direction_of_a_pair(monkeypatch):
    """They bring one pair from just below to just above, and one direction of another far, which is not enough."""
    motion, encoders = of_pairs(0.9 * PARTS, 1.0, 100.0), of_pairs(1.1 * PARTS, 1.0, 100.0)
    encoders[0, 2] = 3.0 * PARTS
    found = chosen_by(ROVER, monkeypatch, lambda bench, _: encoders if "velocity.left" in bench.sigma else motion)
    assert not found.sensors


def test_encoders_that_part_one_more_pair_are_asked_for(monkeypatch):
    """Though another pair stays."""

    def losses(bench, motion):
        out = np.full((3, 3), 100.0 if "velocity.left" in bench.sigma else 1.0)
        out[1, 2] = out[2, 1] = 0.0
        return out + np.diag([np.inf] * 3)

    found = chosen_by(ROVER, monkeypatch, losses)
    assert not found.parts and found.sensors == ("velocity.left", "velocity.right")


def test_wheels_get_encoders(monkeypatch):
    found = chosen(ROVER, monkeypatch, lambda encoders, off: 100.0 if encoders else 0.1)
    assert found.parts and found.sensors == ("velocity.left", "velocity.right")


def test_motors_are_switched_off_where_nothing_else_parts(monkeypatch):
    found = chosen(ARM, monkeypatch, lambda encoders, off: 100.0 if off else 0.1)
    off = found.played[0].planned.motion.enabled
    assert found.parts and found.switches and off is not None
    assert 0.1 < (off == 0).mean() < 0.3 and off[0] == off[-1] == 1


def test_what_helps_nothing_is_not_asked_for(monkeypatch):
    for bench in (ARM, ROVER):
        found = chosen(bench, monkeypatch, lambda encoders, off: 0.1)
        assert not found.parts and not found.sensors and not found.switches


@pytest.mark.parametrize("ratio", [0.1, 100.0])
def test_motors_that_were_off_before_are_no_new_wish(monkeypatch, ratio):
    found = chosen(replace(ARM, switches=True), monkeypatch, lambda encoders, off: ratio if off else 0.1)
    assert not found.switches and found.parts == (ratio > PARTS)
