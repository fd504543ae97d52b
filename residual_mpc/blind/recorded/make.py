"""Make a suite of cases out of recorded runs: part the runs, change one half, seal what was changed."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from zlib import crc32

import numpy as np

from residual_mpc.blind.make import MadeSuite, check_apart
from residual_mpc.blind.recorded.case_files import aliases_of, write_case
from residual_mpc.blind.recorded.half import Half
from residual_mpc.blind.recorded.halves import halves
from residual_mpc.blind.recorded.kinds.library import carried_by
from residual_mpc.blind.recorded.log import log_of
from residual_mpc.blind.recorded.recipe import Change, Recipe, draw, plan
from residual_mpc.blind.recorded.robot_text import settings_of
from residual_mpc.blind.recorded.sizing import UntouchedHalves
from residual_mpc.blind.records import Answer
from residual_mpc.blind.seal import Sealed, digest, read_sealed, seal, write_sealed
from residual_mpc.blind.suite import FIRST_TEST_SEED, Entry, Suite, program_version, write_suite
from residual_mpc.errors import BadInput
from residual_mpc.logs.run import Run
from residual_mpc.models.robot_file import RobotFile
from residual_mpc.processes.parallel import Progress, silent

LEVEL = "recorded"


@dataclass(frozen=True)
class RecordedSettings:
    """What to draw: ``cases`` with seeds from ``first_seed`` on, of the ``kinds`` (effects; empty: all that the runs
    can carry)."""

    cases: int = 5
    first_seed: int = 0
    kinds: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.cases < 1:
            raise BadInput(f"must be >= 1, got {self.cases}", "--cases")
        last = self.first_seed + self.cases - 1
        if self.first_seed < 0 or (self.first_seed < FIRST_TEST_SEED <= last):
            raise BadInput(
                f"seeds must be all development or all test seeds, got {self.first_seed} to {last}",
                "--seed",
                f"development seeds are 0 to {FIRST_TEST_SEED - 1}, test seeds start at {FIRST_TEST_SEED}",
            )

    @property
    def test(self) -> bool:
        return self.first_seed >= FIRST_TEST_SEED


def make_recorded_suite(
    robot: RobotFile, runs: Sequence[Run], settings: RecordedSettings, folder: Path, answers: Path,
    progress: Progress = silent,
) -> MadeSuite:  # fmt: skip
    """Write the cases to ``folder``, the sealed answers to ``answers``; resume where a call stopped.

    Raises BadInput where the runs cannot be parted, where they cannot carry a kind that was asked for, and where a
    call that asked for other cases has begun a suite there.
    """
    check_apart(folder, answers)
    carried_by(two_halves(robot, runs, np.random.default_rng(0))[1], settings.kinds)  # before anything is written
    (folder / "cases").mkdir(parents=True, exist_ok=True)
    answers.mkdir(parents=True, exist_ok=True)
    recipes = plan(robot.name, settings.cases, settings.first_seed, settings.test)
    entries, failed = [], []
    for done, recipe in enumerate(recipes, start=1):
        made = _kept(recipe, robot, settings, folder, answers) or _one(recipe, robot, runs, settings, folder, answers)
        if isinstance(made, Entry):
            entries.append(made)
        else:
            failed.append((recipe.name, made))
        progress(f"{recipe.name} ({done} of {len(recipes)})", done / len(recipes))
    suite = Suite(folder, "test" if settings.test else "development", program_version(), tuple(entries))
    write_suite(suite)
    return MadeSuite(suite, tuple(failed))


def changed_halves(
    robot: RobotFile, runs: Sequence[Run], settings: RecordedSettings, recipe: Recipe
) -> tuple[Half, Half, Half, tuple[Change, ...]]:
    """(before, after untouched, after changed, the changes in the order in which they were put in) of one recipe."""
    rng = np.random.default_rng([recipe.seed, crc32(LEVEL.encode()), crc32(robot.name.encode())])
    before, after = two_halves(robot, runs, rng)
    carried = carried_by(after, settings.kinds)
    changes = draw(carried, recipe, rng, UntouchedHalves.of(robot, before, after).sized) if recipe.number else ()
    changed = after
    for change in changes:
        changed = change.kind.apply(changed, change.target, change.sizes, rng)
    return before, after, changed, changes


def two_halves(robot: RobotFile, runs: Sequence[Run], rng: np.random.Generator) -> tuple[Half, Half]:
    """(before, after) of the runs, untouched."""
    aliases, settings = aliases_of(robot), settings_of(robot)
    tails = [run.name.rpartition("/")[2] for run in runs]
    short = len(set(tails)) == len(tails)
    named = [replace(r, name=tail if short else r.name.replace("/", "_")) for r, tail in zip(runs, tails, strict=True)]
    first, second = (
        Half(robot.name, robot.plant, tuple(log_of(run, f"{name}_{run.name}", aliases) for run in part), settings,
             robot.payload_site)
        for name, part in zip(("before", "after"), halves(named, rng), strict=True)
    )  # fmt: skip
    return first, second


def _one(
    recipe: Recipe, robot: RobotFile, runs: Sequence[Run], settings: RecordedSettings, folder: Path, answers: Path
) -> Entry | str:
    """One case, whole or not at all; the reason where it cannot be made."""
    work, final = folder / "cases" / f".{recipe.name}", folder / "cases" / recipe.name
    for path in (work, final):
        shutil.rmtree(path, ignore_errors=True)
    try:
        before, after, changed, changes = changed_halves(robot, runs, settings, recipe)
        write_case(work, robot, before, changed)
        _check(work)
        answer = _answer(recipe, robot, settings, after, changes)
        sealed = seal(answer, work)
        write_sealed(sealed, answers / f"{recipe.name}.json")
        work.rename(final)
    except Exception as error:  # one case fails alone; the caller lists it
        return f"{type(error).__name__}: {error}"
    finally:
        shutil.rmtree(work, ignore_errors=True)
    return _entry(recipe.name, sealed)


def _check(case: Path) -> None:
    """Raises BadInput where the case's own robot file or one of its models is not valid."""
    from residual_mpc.api.robot import load_robot
    from residual_mpc.api.run_models import RunModels

    robot = load_robot(case / "robot.toml")
    models = RunModels(robot)
    for variant in robot.file.variants:
        models.of(variant.runs.replace("*", "x"))


def _answer(
    recipe: Recipe, robot: RobotFile, settings: RecordedSettings, after: Half, changes: tuple[Change, ...]
) -> Answer:
    places = {
        kind.effect: sorted(t for t in targets if t is not None)
        for kind, targets in carried_by(after)
        if kind.effect in {c.kind.effect for c in changes}
    }
    return Answer(
        case=recipe.name, family=robot.name, level=LEVEL, seed=recipe.seed,
        effects=tuple(c.planted for c in changes),
        notes={
            "dose": [c.dose for c in changes],
            "visibility": [round(c.visibility, 2) if np.isfinite(c.visibility) else None for c in changes],
            "place": [c.kind.place for c in changes],
            "targets": places,
            "channels": list(after.measured),
            "asked": [settings.cases, settings.first_seed, list(settings.kinds)],
        },
    )  # fmt: skip


def _entry(name: str, sealed: Sealed) -> Entry:
    return Entry(name, sealed.answer.family, sealed.commitment, ())


def _kept(recipe: Recipe, robot: RobotFile, settings: RecordedSettings, folder: Path, answers: Path) -> Entry | None:
    """The case that an earlier call made for the same job, if it is still whole.

    Raises BadInput for one that was made for another.
    """
    case = folder / "cases" / recipe.name
    try:
        sealed = read_sealed(answers / f"{recipe.name}.json")
    except BadInput:
        return None
    answer = sealed.answer
    asked = [settings.cases, settings.first_seed, list(settings.kinds)]
    if (answer.family, answer.level, answer.seed, answer.notes.get("asked")) != (
        robot.name, LEVEL, recipe.seed, asked,
    ):  # fmt: skip
        raise BadInput(
            "this folder contains a suite of another robot, or with other kinds, seeds or numbers",
            str(folder),
            "repeat the command that started it, or give another folder",
        )
    return _entry(recipe.name, sealed) if case.is_dir() and digest(case) == sealed.data else None
