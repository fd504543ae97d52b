"""Makes the helpers of one folder importable from another: pytest puts this file's folder on the path. What all tests
would repeat, and none of them is about, is done once or less of it."""

from collections.abc import Iterator
from functools import cache
from importlib.metadata import entry_points

import pytest

from residual_mpc.diagnosis.remainder.learning import RidgeLearner


@pytest.fixture(scope="session", autouse=True)
def entry_points_read_once() -> Iterator[None]:
    """Packages stay as they are while the tests run, and to list their entry points takes as long as a small test."""
    once = cache(entry_points)
    with pytest.MonkeyPatch.context() as patch:
        for module in ("residual_mpc.models.load", "residual_mpc.models.model_structure"):
            patch.setattr(f"{module}.entry_points", once)
        yield


@pytest.fixture(scope="module", autouse=True)
def short_films(request: pytest.FixtureRequest) -> Iterator[None]:
    """Reports show the robot's motion in a few frames, since a whole film takes longer than a small diagnosis; the
    tests of the report itself see all of them."""
    with pytest.MonkeyPatch.context() as patch:
        if request.path.parent.name != "report":
            patch.setattr("residual_mpc.report.motion.film.FRAMES", 3)
            patch.setattr("residual_mpc.report.motion.film.LONG_FRAMES", 5)
            patch.setattr("residual_mpc.report.motion.drive_film.FRAMES", 5)
        yield


@pytest.fixture(scope="module", autouse=True)
def ridge_regression_alone(request: pytest.FixtureRequest) -> Iterator[None]:
    """Tests of what is named train no network on what is left; `tests/learning` does."""
    with pytest.MonkeyPatch.context() as patch:
        if request.path.parent.name in ("diagnosis", "experiment", "cli"):
            patch.setattr("residual_mpc.api.diagnosis.LEARNERS", (RidgeLearner(),))
        yield
