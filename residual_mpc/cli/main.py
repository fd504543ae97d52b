"""The command line: parsing and printing only. Heavy imports happen inside the commands."""

import sys
import warnings
from collections.abc import Sequence
from typing import TextIO

import click

from residual_mpc.cli.options import with_options
from residual_mpc.errors import BadInput


class _Lazy(click.Group):
    """Commands by name, imported when they are called, so that --help answers at once."""

    commands_in = {
        "check": ("residual_mpc.cli.check", "check", "Audit the runs and report what to fix before fitting."),
        "init": ("residual_mpc.cli.init", "init", "Draft a robot file from a model and a log, listing every guess."),
        "gap": ("residual_mpc.cli.gap", "gap", "Measure the gap between the model and the runs."),
        "diagnose": (
            "residual_mpc.cli.diagnose",
            "diagnose",
            "Find where the gap lies, what causes it and how far it shrinks.",
        ),
        "batch": ("residual_mpc.cli.batch", "batch", "Diagnose many robots, each from a folder of its runs."),
        "compare": ("residual_mpc.cli.compare", "compare", "Find what changed between two sets of runs."),
        "watch": ("residual_mpc.cli.watch", "watch", "Follow logs as they arrive and say when something changes."),
        "excite": ("residual_mpc.cli.excite", "excite", "Plan the next motions and write them to a command file."),
        "learn": ("residual_mpc.cli.learn", "learn", "Train the residual network on runs with a Kalman filter."),
        "export": ("residual_mpc.cli.export", "export", "Export the augmented model, or its predictions for viewers."),
        "run": ("residual_mpc.cli.run", "run", "Run a closed-loop scenario: nominal vs. augmented controller."),
        "index": ("residual_mpc.cli.index", "index", "Write one page for a folder of results."),
        "blind": ("residual_mpc.cli.blind", "blind", "Make, run and score sealed benchmark cases."),
    }

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(self.commands_in)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in self.commands_in:
            return None
        from importlib import import_module

        module, name, _ = self.commands_in[cmd_name]
        command: click.Command = getattr(import_module(module), name)
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl([(name, summary) for name, (_, _, summary) in self.commands_in.items()])


@click.group(cls=_Lazy, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="residual-mpc")
def cli() -> None:
    """Find out why a robot and its model disagree: which unmodelled effects cause the gap, and how far it shrinks."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line. Exit status 0 done, 2 bad input, 1 anything else."""
    usual = warnings.showwarning
    _tell_warnings()
    try:
        cli.main(args=None if arguments is None else list(arguments), standalone_mode=False)
    except BadInput as error:
        click.echo(f"residual-mpc: {with_options(str(error))}", err=True)
        sys.exit(2)
    except click.UsageError as error:
        error.show()
        sys.exit(2)
    except click.ClickException as error:
        error.show()
        sys.exit(1)
    except (click.Abort, KeyboardInterrupt):
        click.echo(f"residual-mpc: stopped{_going_on(sys.argv[1:] if arguments is None else arguments)}", err=True)
        sys.exit(1)
    except BrokenPipeError:
        sys.exit(1)
    finally:
        warnings.showwarning = usual
    sys.exit(0)


def _going_on(arguments: Sequence[str]) -> str:
    """How a stopped command goes on, for those that can."""
    if "diagnose" not in arguments or not any(a.startswith("--out") for a in arguments):  # nothing is kept
        return ""
    return "; run the same command again to resume. unfinished.json holds the best set of effects found so far, if any"


def _tell_warnings() -> None:
    """What this package warns of is told like its errors, without the line of code; what other packages warn of is
    shown as usual."""
    usual = warnings.showwarning

    def show(
        message: Warning | str, category: type[Warning], filename: str, lineno: int,
        file: TextIO | None = None, line: str | None = None,
    ) -> None:  # fmt: skip
        if category.__module__.startswith("residual_mpc."):
            click.echo(f"warning: {with_options(str(message))}", err=True)
        else:
            usual(message, category, filename, lineno, file, line)

    warnings.showwarning = show


if __name__ == "__main__":
    main()
