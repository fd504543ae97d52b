"""Every notebook runs from top to bottom in a kernel of its own, and shows what its text says that it shows."""

import ast
import json
import re
from pathlib import Path
from typing import Any

import pytest

FOLDER = Path(__file__).resolve().parents[2] / "notebooks"
NAMES = (
    "1_the_gap",
    "2_where",
    "3_which_and_how_far",
    "4_the_learned_residual",
    "5_the_augmented_mpc",
    "6_tracking_error_analysed",
    "7_the_blind_benchmark",
)
TIMEOUT = 300  # s a cell, on a machine with other things to do


def read(name: str) -> Any:
    nbformat = pytest.importorskip("nbformat", reason="needs the extra `test`")
    return nbformat.read(FOLDER / f"{name}.ipynb", as_version=4)


def executed(name: str, ask: str = "") -> tuple[str, int]:
    """All that the notebook prints, and how many pictures it shows. A cell that fails raises.

    ask: Python to run in the same kernel at the end, whose output is appended: what a picture shows, as figures.
    """
    nbclient = pytest.importorskip("nbclient", reason="needs the extra `test`")
    notebook = read(name)
    if ask:
        notebook.cells.append(pytest.importorskip("nbformat").v4.new_code_cell(ask))
    place = {"metadata": {"path": str(FOLDER)}}
    nbclient.NotebookClient(notebook, timeout=TIMEOUT, kernel_name="python3", resources=place).execute()
    outputs = [o for cell in notebook.cells for o in cell.get("outputs", [])]
    text = "".join(o.text for o in outputs if o.output_type == "stream" and o.name == "stdout")
    return text, sum("image/png" in o.get("data", {}) for o in outputs)


def number(pattern: str, text: str) -> float:
    """The number in the first group of `pattern`, the last time that it occurs."""
    found = re.findall(pattern, text)
    assert found, f"no {pattern!r} in:\n{text}"
    return float(found[-1])


def test_the_seven_are_there_and_nothing_else():
    assert sorted(p.stem for p in FOLDER.glob("*.ipynb")) == sorted(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_committed_without_outputs(name):
    for cell in json.loads((FOLDER / f"{name}.ipynb").read_text(encoding="utf-8"))["cells"]:
        if cell["cell_type"] == "code":
            assert cell["outputs"] == [] and cell["execution_count"] is None, cell["id"]


@pytest.mark.parametrize("name", NAMES)
def test_thin(name):
    """Short, explained, and without an own function that the project should have."""
    code = [c.source for c in read(name).cells if c.cell_type == "code"]
    text = [c.source for c in read(name).cells if c.cell_type == "markdown"]
    assert sum(len(c.splitlines()) for c in code) < 120
    assert len(text) >= 4 and text[0].startswith(f"# {name[0]}. ")
    python = [c for c in code if not c.startswith("%%")]
    assert sum(isinstance(n, ast.FunctionDef) for c in python for n in ast.walk(ast.parse(c))) <= 1


def test_each_leads_to_the_next():
    for name, following in zip(NAMES[:-1], NAMES[1:], strict=True):
        last = read(name).cells[-1].source
        assert f"({following}.ipynb)" in last, f"{name} does not end with a link to {following}"


@pytest.mark.slow
def test_the_gap():
    text, pictures = executed("1_the_gap")
    gap, floor = (
        number(p, text) for p in (r"gap at 1 s: ([\d.]+) \(noise", r"gap at 1 s: [\d.]+ \(noise floor ([\d.]+)\)")
    )
    assert 0.11 < gap < 0.14, "its text says 0.12, an eighth of the motion"
    assert floor < 0.3 * gap
    assert pictures == 1


@pytest.mark.slow
def test_where():
    text, pictures = executed("2_where", "print('ASKED', *(r.name for r in where.regimes[:3]), *stages, sep='|')")
    assert "worst channel: pose.theta" in text, "its text says that the heading is worst"
    asked = text.split("ASKED|")[1]
    assert "command reversal" in asked and "large command" in asked, "what its text says of the kinds of motion"
    shares = dict(re.findall(r"'name': '(\w+)', 'share': ([\d.]+)", asked))
    assert float(shares["actuator"]) > 0.5, "what its text says of the stages"
    rest = {k: float(v) for k, v in shares.items() if k != "actuator"}
    assert max(rest, key=rest.get) == "contact"  # type: ignore[arg-type]
    assert max(rest["noise"], rest["unexplained"]) < rest.get("command", 1.0)
    assert pictures == 3


def test_the_learned_residual():
    asked = "print('OFF', np.max(np.abs(correction - truth)), 'OF', np.max(np.abs(truth)))"
    text, pictures = executed("4_the_learned_residual", asked)
    pattern = r"gap ([\d.]+) -> ([\d.]+) on held-out runs"
    before, after = re.findall(pattern, text)[0]
    assert float(after) < 0.7 * float(before), "what the diagnosis may not name is left to the network"
    assert number(r"OFF ([\d.]+)", text) < 0.4 * number(r"OF ([\d.]+)", text), "it learned the hidden geometry"
    assert pictures == 1


@pytest.mark.slow
def test_which_and_how_far():
    text, pictures = executed("3_which_and_how_far")
    for effect, hidden, off in (("actuator_lag", 0.15, 0.02), ("track_width", 1.1, 0.02),
                                ("wheel_radius_mismatch", 1.04, 0.01)):  # fmt: skip
        assert abs(number(rf"{effect}\s+\w+\s+found ([\d.]+)", text) - hidden) < off, effect
    seconds = [float(v) for v in re.findall(r"(?:actuator_lag|command_delay)\s+\w+\s+found ([\d.]+)", text)]
    assert abs(sum(seconds) - 0.165) < 0.01 and "nan" not in text, "its text says 165 ms, lag and delay together"
    straight = text.split("found")[-1]
    assert "wheel_radius_mismatch" in straight and "track_width" not in straight, "what its text says"
    assert number(r"actuator_lag: .* probability ([\d.]+)", straight) < 0.5
    assert pictures == 1


@pytest.mark.slow
def test_the_augmented_mpc():
    text, pictures = executed("5_the_augmented_mpc")
    nominal, augmented = (number(rf"{n}\s+off the path by ([\d.]+) mm", text) for n in ("nominal", "augmented"))
    assert augmented < 0.5 * nominal
    assert number(r"differs by at most ([\d.e+-]+) over", text) < 1e-9
    assert pictures == 2


@pytest.mark.slow
def test_tracking_error_analysed():
    text, pictures = executed("6_tracking_error_analysed")
    assert number(r"recovered by the diagnosed effects: ([\d.]+)", text) > 0.8
    driven = text.split("recovered")[1]
    assert number(r"gap at 1 s: [\d.]+ -> ([\d.]+)", driven) < 0.3 * number(r"gap at 1 s: ([\d.]+) ->", driven)
    assert pictures == 1


@pytest.mark.slow
def test_the_blind_benchmark():
    text, pictures = executed("7_the_blind_benchmark")
    assert "3 of 3 cases diagnosed" in text and " 0 failed" in text
    said, opened = text.split("right", 1)
    assert "nothing hidden" not in said and "nothing hidden" in opened, "the seals are opened last"
    assert pictures == 1
