"""Make a suite: draw the cases, seal the answers, keep the two apart."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from residual_mpc.blind.best_fit import with_best_fit
from residual_mpc.blind.families import levels_of, load_family, load_level, make_case
from residual_mpc.blind.seal import Sealed, digest, read_sealed, seal, write_sealed
from residual_mpc.blind.suite import FIRST_TEST_SEED, Entry, Suite, program_version, write_suite
from residual_mpc.errors import BadInput
from residual_mpc.processes.parallel import Progress, run_in_parallel, silent


@dataclass(frozen=True)
class MakeSettings:
    """What to draw: ``cases`` of each family at each level that it has, with seeds from ``first_seed`` on. A family
    may have a number of its own: "arm=6"."""

    families: tuple[str, ...]
    levels: tuple[str, ...]
    cases: int = 5
    first_seed: int = 0
    jobs: int = -1  # processes; -1: all cores

    def __post_init__(self) -> None:
        counts = [self.count(name) for name in self.families]
        if min(self.cases, *counts) < 1:
            raise BadInput(f"must be >= 1, got {min(self.cases, *counts)}", "--cases")
        last = self.first_seed + max(counts) - 1
        if self.first_seed < 0 or (self.first_seed < FIRST_TEST_SEED <= last):
            raise BadInput(
                f"seeds must be all development or all test seeds, got {self.first_seed} to {last}",
                "--seed",
                f"development seeds are 0 to {FIRST_TEST_SEED - 1}, test seeds start at {FIRST_TEST_SEED}",
            )
        for name in self.families:
            load_family(_family(name))
        for name in self.levels:
            load_level(name)
        if not any(self.drawn(name) for name in self.families):
            raise BadInput(
                f"level {', '.join(self.levels)} does not exist in family {', '.join(self.families)}",
                "--level",
                "choose a level that one of the families has",
            )

    def drawn(self, family: str) -> tuple[str, ...]:
        """The levels asked for that ``family`` has, in the order asked."""
        has = levels_of(load_family(_family(family)))
        return tuple(level for level in self.levels if level in has)

    def count(self, family: str) -> int:
        """Cases of ``family``, as it was asked for, at each level."""
        _, given, number = family.partition("=")
        if given and not number.isdecimal():
            raise BadInput(f"must be FAMILY or FAMILY=NUMBER such as arm=6, got {family!r}", "--family")
        return int(number) if given else self.cases


def _family(asked: str) -> str:
    return asked.partition("=")[0]


@dataclass(frozen=True)
class MadeSuite:
    """The suite, and the cases that could not be drawn, with why."""

    suite: Suite
    failed: tuple[tuple[str, str], ...]


def make_suite(settings: MakeSettings, folder: Path, answers: Path, progress: Progress = silent) -> MadeSuite:
    """Write the cases to ``folder``, the sealed answers to ``answers``; resume where a call stopped.

    Raises BadInput where a call that asked for other cases has begun a suite there.
    """
    from joblib import delayed

    check_apart(folder, answers)
    (folder / "cases").mkdir(parents=True, exist_ok=True)
    answers.mkdir(parents=True, exist_ok=True)
    plan = _plan(settings)
    found: dict[str, Entry | str] = {
        name: entry for name, *job in plan if (entry := _kept(name, tuple(job), folder, answers))
    }
    todo = [case for case in plan if case[0] not in found]
    calls = (delayed(_one)(*case, folder, answers) for case in todo)
    outcomes = run_in_parallel(calls, [name for name, *_ in todo], progress, n_jobs=settings.jobs)
    found |= {case[0]: outcome for case, outcome in zip(todo, outcomes, strict=True)}
    entries = [found[name] for name, *_ in plan]
    failed = tuple((name, str(found[name])) for name, *_ in plan if isinstance(found[name], str))
    seeds = "test" if settings.first_seed >= FIRST_TEST_SEED else "development"
    suite = Suite(folder, seeds, program_version(), tuple(e for e in entries if isinstance(e, Entry)))
    write_suite(suite)
    return MadeSuite(suite, failed)


def _plan(settings: MakeSettings) -> list[tuple[str, str, str, int]]:
    """(name, family, level, seed) of every case, in an order that says nothing of its level."""
    every = [
        (_family(family), level, seed)
        for family in settings.families
        for level in settings.drawn(family)
        for seed in range(settings.first_seed, settings.first_seed + settings.count(family))
    ]
    order = np.random.default_rng([settings.first_seed, len(every)]).permutation(len(every))
    return [(f"case-{place + 1:04d}", *every[k]) for place, k in enumerate(order)]


def _one(name: str, family: str, level: str, seed: int, folder: Path, answers: Path) -> Entry | str:
    """One case, whole or not at all; the reason where it cannot be drawn."""
    work, final = folder / "cases" / f".{name}", folder / "cases" / name
    for path in (work, final):
        shutil.rmtree(path, ignore_errors=True)
    try:
        answer = with_best_fit(make_case(family, level, seed, work), work / "clean", work / "case")
        sealed = seal(answer, work / "case")
        write_sealed(sealed, answers / f"{name}.json")
        (work / "case").rename(final)
    except Exception as error:  # one case fails alone; the caller lists it
        return f"{type(error).__name__}: {error}"
    finally:
        shutil.rmtree(work, ignore_errors=True)
    return _entry(name, family, sealed)


def _entry(name: str, family: str, sealed: Sealed) -> Entry:
    return Entry(name, family, sealed.commitment, tuple(sealed.answer.withheld))


def _kept(name: str, job: tuple[object, ...], folder: Path, answers: Path) -> Entry | None:
    """The case that an earlier call made for the same ``job`` (family, level, seed), if it is still whole.

    Raises BadInput for one that was made for another.
    """
    case = folder / "cases" / name
    try:
        sealed = read_sealed(answers / f"{name}.json")
    except BadInput:
        return None
    answer = sealed.answer
    if (answer.family, answer.level, answer.seed) != job:
        raise BadInput(
            "this folder contains a suite with other families, levels, seeds or numbers",
            str(folder),
            "repeat the command that started it, or give another folder",
        )
    if not case.is_dir() or digest(case) != sealed.data:
        return None
    return _entry(name, answer.family, sealed)


def check_apart(folder: Path, answers: Path) -> None:
    """Raises BadInput where the answers would travel with the suite."""
    inner, outer = answers.resolve(), folder.resolve()
    if inner == outer or outer in inner.parents:
        raise BadInput("the answers must not be inside the suite", str(answers), "give another folder")


def default_answers(folder: Path) -> Path:
    """Where the answers of the suite in ``folder`` are kept unless told otherwise: beside it."""
    whole = folder.resolve()
    return whole.with_name(whole.name + "-answers")
