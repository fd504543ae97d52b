"""The rules of the house that a machine can check: style, types, imports, packaging, forbidden words."""

import ast
import os
import re
import subprocess
import sys
import zipfile
from importlib.metadata import entry_points
from pathlib import Path

import pytest

from residual_mpc.effects.library import BY_NAME

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("residual_mpc", "controllers", "plants", "scenarios")
HEAVY = ("pandas", "mujoco", "scipy", "matplotlib", "jax", "casadi", "pyarrow")


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Run this interpreter with `arguments` at the root of the repository."""
    return subprocess.run([sys.executable, *arguments], cwd=ROOT, capture_output=True, text=True, check=False)


def tracked_files() -> list[Path]:
    listing = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=False)
    if listing.returncode != 0:
        pytest.skip("not a git checkout: nothing says which files belong to the project")
    return [ROOT / name for name in listing.stdout.split("\0") if name and (ROOT / name).is_file()]


def test_ruff_is_clean():
    result = run("-m", "ruff", "check", "--no-cache", ".")
    assert result.returncode == 0, result.stdout + result.stderr


def test_mypy_is_clean():
    result = run("-m", "mypy", "--cache-dir", os.devnull)  # a cache hides errors that depend on order
    assert result.returncode == 0, result.stdout + result.stderr


def test_imports_point_one_way():
    lint = "from importlinter.cli import lint_imports_command as lint; lint(['--no-cache'])"
    result = run("-c", lint)
    assert result.returncode == 0, result.stdout + result.stderr


def test_help_imports_nothing_heavy():
    """`--help` must answer at once, so the heavy libraries are imported where they are used."""
    program = (
        "import sys\n"
        "from residual_mpc.cli.main import main\n"
        "sys.argv = ['residual-mpc', '--help']\n"
        "try:\n    main()\n"
        "except SystemExit as end:\n    assert not end.code, end.code\n"
        f"print('HEAVY', [name for name in {HEAVY!r} if name in sys.modules])\n"
    )
    result = run("-c", program)
    assert result.returncode == 0, result.stderr
    assert result.stdout.splitlines()[-1] == "HEAVY []"


def effect_names(tree: ast.AST) -> list[str]:
    return [n.value for n in ast.walk(tree) if isinstance(n, ast.Constant) and n.value in BY_NAME]


def test_an_effect_is_known_to_its_own_record():
    """What holds for an effect is said in `effects`: elsewhere its name is rare, and nothing depends on it."""
    literals, decided = [], []
    for path in [p for name in PACKAGES for p in (ROOT / name).rglob("*.py") if "effects" not in p.parts]:
        tree = ast.parse(path.read_text())
        literals += effect_names(tree)
        for node in ast.walk(tree):
            tests = [node.test] if isinstance(node, ast.If | ast.IfExp | ast.While) else []
            tests += [node] if isinstance(node, ast.Compare | ast.match_case) else []
            tests += node.ifs if isinstance(node, ast.comprehension) else []
            decided += [f"{path.relative_to(ROOT)}: {name}" for test in tests for name in effect_names(test)]
    assert not decided, decided
    assert len(literals) < 60, len(literals)


@pytest.mark.parametrize("what", ["robots", "model_structures", "scenarios", "blind_families"])
def test_entry_points_resolve(what):
    group = f"residual_mpc.{what}"
    ours = [point for point in entry_points(group=group) if point.dist and point.dist.name == "residual-mpc"]
    assert ours, f"no entry point in {group}: install the project (`pip install -e .`)"
    for point in ours:
        point.load()


def test_wheel_holds_every_file_of_the_packages(tmp_path):
    """Modules, templates and robot files; a pattern in .gitignore would silently drop them."""
    result = run("-m", "build", "--wheel", "--no-isolation", "--outdir", str(tmp_path))
    assert result.returncode == 0, result.stdout + result.stderr
    (wheel,) = tmp_path.glob("*.whl")
    packed = set(zipfile.ZipFile(wheel).namelist())
    wanted = {
        path.relative_to(ROOT).as_posix()
        for package in PACKAGES
        for path in (ROOT / package).rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    assert not wanted - packed
    assert "residual_mpc/report/templates/page.html.jinja" in packed
    assert {name.split("/")[0] for name in packed if ".dist-info/" not in name} == set(PACKAGES)


def test_gitignore_hides_no_source():
    sources = [str(p.relative_to(ROOT)) for package in PACKAGES for p in (ROOT / package).rglob("*.py")]
    ignored = subprocess.run(
        ["git", "check-ignore", "--no-index", "--stdin"], cwd=ROOT, input="\n".join(sources),
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    if ignored.returncode == 128:
        pytest.skip("not a git checkout")
    assert ignored.stdout == ""


def test_no_path_of_a_machine_and_no_registry_in_any_file():
    # Written in pieces, so that this file passes its own test.
    paths = ["work", "tmp/ven" + "v", "root", "home/" + r"\w+", "opt/" + r"\w+", "Users/" + r"\w+"]
    hosts = [
        "py" + r"pi\.",
        "python" + r"hosted\.",
        "ana" + r"conda\.",
        "registry." + r"npm",
        "crates" + r"\.io",
    ]
    machine = r"(?<![\w.*}<>)\]-])/(?:" + "|".join(paths) + r")/"
    forbidden = re.compile("|".join([machine, *hosts]).encode())
    found = []
    for path in tracked_files():
        for number, line in enumerate(path.read_bytes().splitlines(), start=1):
            if b"\0" not in line and forbidden.search(line):
                found.append(f"{path.relative_to(ROOT)}:{number}: {line[:120]!r}")
    assert not found, "\n".join(found)
