"""`residual-mpc blind make|run|experiment|score|explain`: the benchmark whose answers are withheld."""

from __future__ import annotations

from pathlib import Path

import click

from residual_mpc.cli.blind_methods import methods_of, score_recorded_runs
from residual_mpc.cli.common import ROBOT, emit, json_option, read, robot_option, runs_argument
from residual_mpc.cli.progress import progress_bar
from residual_mpc.errors import BadInput

_folder = click.Path(path_type=Path, file_okay=False)


@click.group()
def blind() -> None:
    """Make sealed benchmark cases, diagnose them without their answers, and score the diagnoses."""


@blind.command()
@click.option("--out", type=_folder, required=True, help="Folder for the cases.")
@click.option("--answers", type=_folder, help="Folder for the sealed answers, outside --out  [default: OUT-answers]")
@click.option("--family", "families", multiple=True, help="Family, or family=cases; repeatable  [default: all]")
@click.option("--level", "levels", multiple=True, help="Level; repeatable  [default: all]")
@click.option("--from", "runs_from", multiple=True, metavar="RUN",
              help="Recorded runs to put known changes into (file, folder or pattern), in place of simulated families; "
              "repeatable.")
@click.option("--robot", metavar="R", help=f"{ROBOT}, for --from.")
@click.option("--kind", "kinds", multiple=True, metavar="EFFECT",
              help="Kind of change, for --from; repeatable  [default: all that the runs can carry]")
@click.option("--cases", type=int, default=5, show_default=True,
              help="Number of cases per family and level; with --from, of cases.")
@click.option("--seed", type=int, default=0, show_default=True, help="First seed; seeds from 100000 are test seeds.")
@click.option("--jobs", type=int, default=-1, show_default=True, help="Parallel processes; -1 for all cores.")
@json_option
def make(
    out: Path,
    answers: Path | None,
    families: tuple[str, ...],
    levels: tuple[str, ...],
    runs_from: tuple[str, ...],
    robot: str | None,
    kinds: tuple[str, ...],
    cases: int,
    seed: int,
    jobs: int,
    as_json: bool,
) -> None:
    """Draw cases and seal their answers. If interrupted, the same command resumes."""
    from residual_mpc.blind.families import family_names
    from residual_mpc.blind.levels import LEVELS
    from residual_mpc.blind.make import MakeSettings, default_answers, make_suite

    kept = answers or default_answers(out)
    if runs_from or robot is not None or kinds:
        if not runs_from or robot is None or families or levels:
            raise BadInput(
                "--from and --robot go together, with --kind and without --family and --level", "--from",
                "give the recorded runs with --from and their robot with --robot",
            )  # fmt: skip
        from residual_mpc.blind.recorded.make import RecordedSettings, make_recorded_suite

        wanted = RecordedSettings(cases, seed, kinds)
        nominal, logged = read(robot, runs_from, quiet=True)
        with progress_bar() as progress:
            made = make_recorded_suite(nominal.file, logged.runs, wanted, out, kept, progress)
    else:
        settings = MakeSettings(families or family_names(), levels or tuple(LEVELS), cases, seed, jobs)
        with progress_bar() as progress:
            made = make_suite(settings, out, kept, progress)
    for name, why in made.failed:
        click.echo(f"{name} could not be drawn: {why}", err=True)
    if as_json:
        emit({"make": {"cases": len(made.suite.cases), "failed": len(made.failed), "suite": str(out),
                       "answers": str(kept), "seeds": made.suite.seeds}})  # fmt: skip
        return
    cases = len(made.suite.cases)
    click.echo(f"{cases} case{'s' if cases != 1 else ''} in {out}, sealed answers in {kept}")


@blind.command()
@click.argument("suite", type=_folder)
@click.option("--out", type=_folder, required=True, help="Folder for the diagnoses.")
@click.option("--command", default="", help="Another method: a program that takes the options of `diagnose`, or of "
              "`compare` where SUITE is of recorded runs.")
@click.option("--jobs", type=int, default=-1, show_default=True, help="Cases at once; -1 for all cores.")
@click.option("--timeout", type=float, default=600.0, show_default=True, help="Time limit per case in seconds.")
@click.option("--engine", default="processes", show_default=True, help="processes, or dask for several machines.")
@click.option("--address", default="", help="Address of a running Dask scheduler  [default: a local cluster]")
@click.option("--seed", type=int, default=0, show_default=True, help="Seed of every diagnosis.")
@json_option
def run(
    suite: Path,
    out: Path,
    command: str,
    jobs: int,
    timeout: float,
    engine: str,
    address: str,
    seed: int,
    as_json: bool,
) -> None:
    """Diagnose every case of SUITE without its answer, each in its own process and folder.

    In a suite of recorded runs, the halves of each case are compared with `residual-mpc compare`.
    If interrupted, the same command diagnoses only the missing cases.
    """
    from residual_mpc.blind.run import RunSettings, run_suite

    with progress_bar() as progress:
        summary = run_suite(suite, out, RunSettings(command, jobs, timeout, engine, address, seed), progress)
    if as_json:
        emit({"run": {"cases": summary.cases, "diagnosed": summary.diagnosed, "failed": summary.failed,
                      "resumed": summary.resumed, "seconds": summary.seconds}})  # fmt: skip
        return
    click.echo(
        f"{summary.diagnosed} of {summary.cases} cases diagnosed in {summary.seconds:.0f} s, "
        f"{summary.failed} failed, {summary.resumed} already done"
    )


@blind.command()
@click.argument("suite", type=_folder)
@click.option("--results", type=_folder, required=True, help="Folder of `blind run`.")
@click.option("--out", type=_folder, required=True, help="Folder for the experiments.")
@click.option("--answers", type=_folder, help="Folder of the sealed answers  [default: SUITE-answers]")
@click.option("--command", default="", help="Another method: a program that takes the options of `diagnose`.")
@click.option("--planner", default="", help="The method's planner: a program that takes the options of `excite`.")
@click.option("--jobs", type=int, default=-1, show_default=True, help="Cases at once; -1 for all cores.")
@click.option(
    "--timeout",
    type=float,
    default=600.0,
    show_default=True,
    help="Time limit in seconds, for planning and for diagnosing.",
)
@click.option("--seed", type=int, default=0, show_default=True, help="Seed of the plans, the noise and the diagnoses.")
@json_option
def experiment(
    suite: Path,
    results: Path,
    out: Path,
    answers: Path | None,
    command: str,
    planner: str,
    jobs: int,
    timeout: float,
    seed: int,
    as_json: bool,
) -> None:
    """Run the experiment that each diagnosis of SUITE proposes on the hidden robot, and repeat the diagnosis.

    The answers are used only to simulate the robot. If interrupted, the same command resumes.
    """
    from residual_mpc.blind.experiment import ExperimentSettings, run_experiments
    from residual_mpc.blind.make import default_answers
    from residual_mpc.blind.recorded.case_files import is_recorded
    from residual_mpc.blind.suite import read_suite

    if is_recorded(read_suite(suite)):
        raise BadInput("recorded robots run no experiments", str(suite), "make a suite of simulated families")
    settings = ExperimentSettings(command, planner, jobs, timeout, seed)
    with progress_bar() as progress:
        summary = run_experiments(suite, answers or default_answers(suite), results, out, settings, progress)
    if as_json:
        emit({"experiment": {"cases": summary.cases, "open": summary.open, "failed": summary.failed,
                             "resumed": summary.resumed, "seconds": summary.seconds}})  # fmt: skip
        return
    click.echo(
        f"{summary.open} of {summary.cases} diagnoses left something open; ran "
        f"{summary.open - summary.failed} experiments in {summary.seconds:.0f} s, {summary.failed} failed"
    )


@blind.command()
@click.argument("suite", type=_folder)
@click.option(
    "--results", "given", multiple=True, required=True, help="FOLDER of `blind run`, or NAME=FOLDER; repeatable."
)
@click.option("--answers", type=_folder, help="Folder of the sealed answers  [default: SUITE-answers]")
@click.option(
    "--experiments", type=_folder, help="Folder of `blind experiment`, to score what the experiments resolved."
)
@click.option("--explained", type=_folder, help="Folder of `blind explain`, to show why answers were wrong.")
@click.option("--out", type=_folder, help="Folder for score.json and blind.html.")
@click.option("--ledger", type=click.Path(path_type=Path, dir_okay=False),
              help="File that records each opening of test seeds  [default: beside the answers]")  # fmt: skip
@click.option("--seed", type=int, default=0, hidden=True)
@json_option
def score(
    suite: Path,
    given: tuple[str, ...],
    answers: Path | None,
    experiments: Path | None,
    explained: Path | None,
    out: Path | None,
    ledger: Path | None,
    seed: int,
    as_json: bool,
) -> None:
    """Open the answers of SUITE and score the methods against them; the report is about the first method."""
    from residual_mpc.blind.make import default_answers
    from residual_mpc.blind.recorded.case_files import is_recorded
    from residual_mpc.blind.recorded.score.score import Swept
    from residual_mpc.blind.score.score import score_suite
    from residual_mpc.blind.suite import read_suite

    kept = answers or default_answers(suite)
    if is_recorded(read_suite(suite)):
        if experiments is not None:
            raise BadInput("recorded robots run no experiments", "--experiments", "leave it out")
        if explained is not None:
            raise BadInput("comparisons are not explained", "--explained", "leave it out")
        swept = Swept(suite, kept, methods_of(given, "compare"))
        score_recorded_runs(swept, out, ledger or kept / "openings.jsonl", as_json)
        return
    scores = score_suite(suite, kept, methods_of(given), ledger or kept / "openings.jsonl", experiments, explained)
    first = scores.summaries[0].document()
    first["methods"] = [s.document() for s in scores.summaries[1:]]
    if scores.experiments is not None:
        first["experiments"] = scores.experiments.document()
    if out is not None:
        from residual_mpc.blind.score.page import write_page
        from residual_mpc.blind.suite import write_json

        out.mkdir(parents=True, exist_ok=True)
        write_json(out / "score.json", {"score": first})
        write_page(scores, out / "blind.html")
    if as_json:
        emit({"score": first})
        return
    from residual_mpc.blind.score.page import text

    names = [s.method for s in scores.summaries]
    if len(names) > 1:
        click.echo("methods: " + ", ".join(names))
    for line in text(scores):
        click.echo(line)


@blind.command()
@click.argument("suite", type=_folder)
@click.option("--results", type=_folder, required=True, help="Folder of `blind run`, with every case diagnosed.")
@click.option("--out", type=_folder, required=True, help="Folder for explain.json and the new diagnoses.")
@click.option("--answers", type=_folder, help="Folder of the sealed answers  [default: SUITE-answers]")
@click.option("--command", default="", help="Another method: a program that takes the options of `diagnose`.")
@click.option("--jobs", type=int, default=-1, show_default=True, help="Cases at once; -1 for all cores.")
@click.option("--timeout", type=float, default=600.0, show_default=True, help="Time limit per case in seconds.")
@click.option("--ledger", type=click.Path(path_type=Path, dir_okay=False),
              help="File that records each opening of test seeds  [default: beside the answers]")  # fmt: skip
@click.option("--seed", type=int, default=0, show_default=True, help="Seed of every diagnosis.")
@json_option
def explain(
    suite: Path,
    results: Path,
    out: Path,
    answers: Path | None,
    command: str,
    jobs: int,
    timeout: float,
    ledger: Path | None,
    seed: int,
    as_json: bool,
) -> None:
    """Find out why answers are wrong: diagnose those cases again with the planted effects as the only candidates.

    This opens the answers, so every case of SUITE must have been diagnosed. If interrupted, the same command resumes.
    """
    from residual_mpc.blind.explain.explain import ExplainSettings, explain_suite
    from residual_mpc.blind.make import default_answers
    from residual_mpc.blind.score.explained import MEANING, faults, table

    kept = answers or default_answers(suite)
    settings = ExplainSettings(command, jobs, timeout, seed)
    with progress_bar() as progress:
        found = explain_suite(suite, kept, results, out, ledger or kept / "openings.jsonl", settings, progress)
    if as_json:
        emit({"explain": {"cases": found.cases, "faults": faults(found.wrong), "resumed": found.resumed,
                          "wrong": [e.document() for e in found.wrong]}})  # fmt: skip
        return
    for line in table(found.wrong).lines():
        click.echo(line)
    click.echo(f"{len(found.wrong)} of {found.cases} answers are wrong")
    for kind, count in faults(found.wrong).items():
        click.echo(f"{kind:<12} {count:>4}  {MEANING[kind]}")


@blind.command()
@click.argument("method", type=click.Choice(["single", "all_at_once", "sparse"]))
@robot_option
@runs_argument
@click.option("--out", type=_folder, required=True, help="Folder for diagnosis.json.")
@click.option("--without", multiple=True, metavar="EFFECT", help="Exclude this effect; repeatable.")
@click.option("--seed", type=int, default=0, hidden=True)
@json_option
def baseline(
    method: str,
    robot: str,
    runs: tuple[str, ...],
    out: Path,
    without: tuple[str, ...],
    seed: int,
    as_json: bool,
) -> None:
    """Run a baseline method with the options of `diagnose`, for use in `blind run --command`."""
    from importlib import import_module

    from residual_mpc.blind.baselines.problem import build_baseline_problem, document_of, write_document

    nominal, logged = read(robot, runs, quiet=True)
    problem = build_baseline_problem(logged.runs, logged.models, logged.noise, nominal.file.tunable, without)
    fit = getattr(import_module(f"residual_mpc.blind.baselines.{method}"), method)(problem)
    document = document_of(problem, fit, nominal.name)
    write_document(document, out)
    if as_json:
        emit(document)
    else:
        click.echo(", ".join(part["effect"] for part in document["explanation"]) or document["verdict"])
