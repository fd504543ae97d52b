"""`residual-mpc check`."""

import click

from residual_mpc.cli.common import emit, json_option, robot_option, runs_argument, seed_option
from residual_mpc.errors import BadInput


@click.command()
@robot_option
@runs_argument
@json_option
@seed_option
def check(robot: str, runs: tuple[str, ...], as_json: bool, seed: int) -> None:
    """Audit the runs against the robot and each other, and report what to fix before fitting.

    The exit status is 2 if the runs cannot be used as they are.
    """
    from residual_mpc.api.check import check as check_runs
    from residual_mpc.api.robot import load_robot
    from residual_mpc.report.words.numbers import count

    found = check_runs(load_robot(robot), runs)
    if as_json:
        emit(found.document)
    else:
        for line in found.lines():
            click.echo(line)
    if not found.usable:
        first = found.errors[0]
        raise BadInput(
            f"{count(len(found.errors), 'error')} to fix before these runs can be used; the first: {first.message}",
            first.where,
            first.remedy,
        )
