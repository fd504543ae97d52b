"""What is learned of a diagnosis' remainder: who is chosen and on what, and a planted fault that the network finds."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from oracles.rover_log import rover_run

from plants.diff_drive import DiffDrive
from residual_mpc.diagnosis.data.dataset import build_dataset
from residual_mpc.diagnosis.data.gap import measure_scales
from residual_mpc.diagnosis.diagnose import diagnose
from residual_mpc.diagnosis.options import Options
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.diagnosis.remainder.learning import NOTHING, Learned, Remainder, RidgeLearner, learn, remainder_of
from residual_mpc.diagnosis.remainder.settings import RemainderSettings
from residual_mpc.diagnosis.results.document import to_document
from residual_mpc.learning.batch.network_learner import LEARNERS, NetworkLearner
from residual_mpc.models.settings import Settings

ROVER = DiffDrive("rover", 0.033, 0.16)
TRACK = {"track_width": {"scale": 1.25}}


@dataclass(frozen=True)
class Fake:
    """Leaves so much of the error on the windows that choose, and on those that judge."""

    name: str
    choose: float
    judge: float

    def left(self, of: Remainder, rng: np.random.Generator) -> np.ndarray:
        left = np.full(of.error.shape, np.nan)
        left[of.choose], left[of.judge] = self.choose * of.error[of.choose], self.judge * of.error[of.judge]
        return left


class Forbidden:
    name = "forbidden"

    def left(self, of: Remainder, rng: np.random.Generator) -> np.ndarray:
        raise AssertionError("there is nothing to learn")


@pytest.fixture(scope="module")
def remainder() -> Remainder:
    runs = [rover_run(f"r{k}", TRACK, 30.0, seed=k) for k in range(2)]
    data = build_dataset(runs, [ROVER] * 2, {})
    predicted = predict(data, Settings(1))[0]
    judge = np.arange(data.count) % 8 >= 6
    error = data.y - predicted
    return remainder_of(data, measure_scales(data), Settings(1), predicted, error, judge, tuning=RemainderSettings())


def test_the_windows_are_parted(remainder):
    parts = np.stack([remainder.learn, remainder.choose, remainder.judge])
    assert (parts.sum(axis=0) == 1).all() and parts.any(axis=1).all()


def test_who_chooses_does_not_judge(remainder):
    rng = np.random.default_rng(0)
    good, lucky, bad = Fake("good", 0.5, 0.6), Fake("lucky", 0.4, 0.9), Fake("bad", 1.1, 0.1)
    assert learn(remainder, (good, bad), rng) == Learned(pytest.approx(0.4), "good", ("good", "bad"))
    assert learn(remainder, (good, lucky), rng) == Learned(pytest.approx(0.1), "lucky", ("good", "lucky"))
    assert learn(remainder, (bad,), rng) == Learned(0.0, None, ("bad",))
    assert learn(remainder, (Fake("worse in the end", 0.5, 1.5),), rng).shrink == 0.0


def test_a_learner_that_removes_no_more_than_rounding_has_learned_nothing(remainder):
    """A network whose outputs are all switched off leaves the error of another call of the same model."""
    nothing = Fake("nothing", 1.0 - 4e-16, 1.0 - 4e-16)
    assert learn(remainder, (nothing,), np.random.default_rng(0)) == Learned(0.0, None, ("nothing",))


def test_a_learner_that_runs_away_is_not_chosen(remainder):
    assert learn(remainder, (Fake("lost", 0.5, np.nan),), np.random.default_rng(0)) == Learned(0.0, None, ("lost",))


def test_without_windows_that_choose_nobody_is_asked(remainder):
    none = replace(remainder, choose=np.zeros_like(remainder.choose))
    assert learn(none, (Forbidden(),), np.random.default_rng(0)) is NOTHING


def test_the_network_learns_a_planted_track(remainder):
    """The judged windows play no part in it: with other readings there, the same is left on those that choose."""
    network = NetworkLearner()
    found = learn(remainder, (RidgeLearner(), network), np.random.default_rng(0))
    assert found.by == "network" and found.shrink > 0.6
    y = np.where(remainder.judge[:, None, None], 7.0, remainder.data.y)
    spoilt = replace(remainder, data=replace(remainder.data, y=y), error=y - remainder.predicted)
    left = [network.left(r, np.random.default_rng(0))[remainder.choose] for r in (remainder, spoilt)]
    np.testing.assert_array_equal(*left)


def test_too_few_windows_are_not_learned_from(remainder):
    few = replace(remainder, learn=remainder.learn & (np.cumsum(remainder.learn) <= 5))
    assert NetworkLearner().left(few, np.random.default_rng(0)) is None


def test_where_the_noise_explains_the_rest_nobody_is_asked():
    for faults in (TRACK, {}):
        run = rover_run("one", faults, 20.0, seed=1)
        made = diagnose([run], [ROVER], {}, (), Options(), np.random.default_rng(0), learners=(Forbidden(),)).diagnosis
        assert made.verdict in ("effects", "no_gap") and made.learned is NOTHING


@pytest.mark.slow
def test_a_diagnosis_says_who_learned_what_and_is_else_the_same():
    runs = [rover_run("one", TRACK, 24.0, seed=1), rover_run("two", TRACK, 16.0, seed=2)]
    options = Options(only=("command_delay",))
    plain, learned = (
        to_document(diagnose(runs, [ROVER] * 2, {}, (), options, np.random.default_rng(0), learners=who).diagnosis)
        for who in ((), LEARNERS)
    )
    assert plain["verdict"] == "unknown" and plain["learned"] == {"by": None, "asked": []}
    assert learned["learned"] == {"by": "network", "asked": ["ridge", "network"]}
    assert learned["unexplained"].pop("learned_residual_shrink") > 0.6
    assert plain["unexplained"].pop("learned_residual_shrink") == 0.0
    assert {k: v for k, v in plain.items() if k != "learned"} == {k: v for k, v in learned.items() if k != "learned"}
