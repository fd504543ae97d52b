"""`residual-mpc run`."""

import math
from pathlib import Path

import click

from residual_mpc.cli.common import emit, json_option, seed_option, writable_folder
from residual_mpc.cli.progress import progress_bar


@click.command()
@click.argument("scenario", required=False)
@click.option(
    "--controller", type=click.Choice(["mpc", "lqr"]), default="mpc", show_default=True, help="Controller type."
)
@click.option("--seeds", type=click.IntRange(1, 1000), default=10, show_default=True, help="Number of plants to draw.")
@click.option(
    "--budget", type=click.FloatRange(min=0.0, min_open=True), metavar="S",
    help="Time limit of the MPC per sample in seconds, after which it applies its current plan; results then depend on "
    "the machine. Without a limit, late samples are only counted.",
)  # fmt: skip
@click.option(
    "--out", type=click.Path(path_type=Path), help="Folder for the episodes (as runs), the diagnosis and the figure."
)
@json_option
@seed_option
def run(
    scenario: str | None, controller: str, seeds: int, budget: float | None, out: Path | None, as_json: bool, seed: int
) -> None:
    """Run a closed-loop SCENARIO that compares the nominal and the augmented controllers; without a name, list them.

    The nominal controller first records a log, the log is diagnosed, and then every controller drives every seed. With
    ten seeds this takes some minutes.
    """
    from residual_mpc.closed_loop.scenario import RunOptions, find_scenario, scenario_names

    if scenario is None:
        summaries = {name: find_scenario(name).summary for name in scenario_names()}
        if as_json:
            emit({"scenarios": [{"name": n, "summary": s} for n, s in summaries.items()]})
            return
        width = max((len(n) for n in summaries), default=0)
        for name, summary in summaries.items():
            click.echo(f"{name:<{width}}  {summary}")
        return
    found = find_scenario(scenario)
    if out is not None:
        writable_folder(out)
    options = RunOptions("lqr" if controller == "lqr" else "mpc", seeds, seed, out, budget or math.inf)
    with progress_bar() as progress:
        result = found.run(options, progress)
    if as_json:
        emit(result)
        return
    click.echo(f"{found.name}: {found.summary}")
    for name, c in result.get("controllers", {}).items():
        h2 = c["h2_norm"].values() if isinstance(c["h2_norm"], dict) else [c["h2_norm"]]
        norm = " -> ".join("diverged" if v is None else f"{v:.3f}" for v in h2)
        share = (result["recovered"].get(name) or {}).get("value")
        got = "" if share is None else f"   recovered {share:.0%}"
        late = f", {c['late']} late" if c.get("late") else ""
        click.echo(
            f"  {name:<10} tracking {1e3 * c['tracking_rmse']:6.2f} mm   H2 {norm}   "
            f"{c['solve_ms']['median']:.2f} ms a step, {c['failures']} failures{late}{got}"
        )
    if "h2_norm" in result:
        click.echo(f"  H2 norm {result['h2_norm']['first']:.3f} -> {result['h2_norm']['last']:.3f}")
