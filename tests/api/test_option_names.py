"""A message of the Python functions names their arguments, and the command line its options in their place."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import click
import pytest
from oracles.rover_log import ROBOT, rover_run, write_run

import residual_mpc as rm
from residual_mpc.cli import compare, diagnose, excite, export, gap, learn, run, watch
from residual_mpc.cli.main import main
from residual_mpc.cli.options import OPTIONS, with_options

ROOT = Path(__file__).parents[2]
PACKAGES = ("api", "comparison", "experiment", "export", "learning", "models", "monitoring", "report")
OPTION = re.compile(r"(?<![\w-])--[a-z]")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    there = tmp_path_factory.mktemp("rover")
    (there / "robot.toml").write_text(ROBOT)
    for seed, name in enumerate(("one", "two")):
        write_run(rover_run(name, {}, 6.0, seed=seed), there)
    return there


def said(capsys: pytest.CaptureFixture[str], *words: str | Path) -> str:
    with pytest.raises(SystemExit) as end:
        main([str(w) for w in words])
    assert end.value.code == 2
    return capsys.readouterr().err


def test_effects_that_do_not_exist(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    robot = rm.load_robot(folder / "robot.toml")
    runs = rm.read_runs(robot, [folder / "one.csv", folder / "two.csv"])
    with pytest.raises(rm.BadInput, match=r"^`only`: unknown effect 'paylod'"):
        rm.diagnose(robot, runs, only=["paylod"])
    call = ("diagnose", "--robot", folder / "robot.toml", folder / "one.csv", "--out", folder / "out")
    assert "residual-mpc: --only: unknown effect 'paylod'" in said(capsys, *call, "--only", "paylod")


def test_limits_of_commands(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(rm.BadInput, match=r'Set them with `limits={"left": \(LOW, HIGH\), "right": \(LOW, HIGH\)}`'):
        rm.excite(rm.load_robot(folder / "robot.toml"))
    call = ("excite", "--robot", folder / "robot.toml", "--out", folder / "next.csv")
    assert "Set them with --limit left=LOW:HIGH --limit right=LOW:HIGH." in said(capsys, *call)
    assert "--limit: unknown actuator 'lef'" in said(capsys, *call, "--limit", "lef=-1:1")


def test_values_and_other_words() -> None:
    assert with_options("`to=mjcf`: no. Set `kp`, or run `residual-mpc learn`") == (
        "--to mjcf: no. Set `kp`, or run `residual-mpc learn`"
    )
    assert with_options("`step()` of the plant raised") == "`step()` of the plant raised"
    assert with_options("`changed=payload+=0.2`: unknown") == "--changed payload+=0.2: unknown"


def test_every_option_exists() -> None:
    commands = (
        compare.compare, diagnose.diagnose, excite.excite, export.export, gap.gap, learn.learn, run.run, watch.watch,
    )  # fmt: skip
    assert all(isinstance(c, click.Command) for c in commands)
    assert set(OPTIONS.values()) <= {name for c in commands for p in c.params for name in p.opts}


@pytest.mark.parametrize("package", PACKAGES)
def test_no_message_of_a_function_names_an_option(package: str) -> None:
    for file in sorted((ROOT / "residual_mpc" / package).rglob("*.py")):
        for text in messages(ast.parse(file.read_text())):
            assert "residual-mpc" in text or not OPTION.search(text), (file.name, text)


def messages(tree: ast.AST) -> Iterator[str]:
    """The texts of what is raised."""
    for call in (n for n in ast.walk(tree) if isinstance(n, ast.Call)):
        if isinstance(call.func, ast.Name) and call.func.id == "BadInput":
            yield from (n.value for n in ast.walk(call) if isinstance(n, ast.Constant) and isinstance(n.value, str))
