"""The pages: the Python of the guide runs as it stands, every link leads somewhere, and every page is in the menu."""

from __future__ import annotations

import json
import re
import runpy
import shutil
from collections.abc import Iterator
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from comparison.rovers import write_sets
from oracles.arms import SERVOS, arm_xml
from oracles.rover_log import ROBOT, rover_run, write_run

from residual_mpc.comparison.settings import ComparisonSettings

HOUSE = Path(__file__).resolve().parents[2]
DOCS = HOUSE / "docs"
GUIDE = DOCS / "guide"
PAGES = [HOUSE / "README.md", HOUSE / "CONTRIBUTING.md", HOUSE / "CHANGELOG.md", *sorted(DOCS.rglob("*.md"))]
PARTS = ("tutorials", "howto", "guide", "notebooks", "reference", "results")


def text(page: Path) -> str:
    return page.read_text(encoding="utf-8")


def blocks(page: Path) -> list[str]:
    """The page's blocks of Python."""
    return re.findall(r"^```python\n(.*?)^```", text(page), flags=re.S | re.M)


def run(page: str, folder: Path = GUIDE) -> dict[str, Any]:
    """All blocks of a page, one after the other, in the working folder."""
    found = blocks(folder / page)
    assert found
    space: dict[str, Any] = {"__name__": page}
    exec(compile("\n".join(found), page, "exec"), space)
    return space


@pytest.fixture
def rover(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a rover's robot file and three runs in which its motors lag by 0.1 s."""
    (tmp_path / "robot.toml").write_text(ROBOT)
    (tmp_path / "runs").mkdir()
    for k in range(3):
        write_run(rover_run(f"r{k}", {"actuator_lag": {"time_constant": 0.1}}, seconds=10.0, seed=k), tmp_path / "runs")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_every_python_page_of_the_guide_is_run_here() -> None:
    own, quoted = text(Path(__file__)), {"examples.md"}
    pages = [p for p in sorted(GUIDE.glob("*.md")) if p.name not in quoted]
    assert [p.name for p in pages if blocks(p) and f'run("{p.name}")' not in own] == []


def test_the_examples_quote_their_scripts() -> None:
    """tests/examples runs the scripts; their page shows parts of them."""
    scripts = [text(p) for p in sorted((DOCS / "examples").glob("*.py"))]
    plain = ["\n".join(line.strip() for line in s.splitlines()) for s in scripts]
    for block in blocks(GUIDE / "examples.md"):
        wanted = "\n".join(line.strip() for line in block.strip().splitlines())
        assert any(wanted in s for s in plain), block
    assert [p.name for p in (DOCS / "examples").glob("*.py") if p.name not in text(GUIDE / "examples.md")] == []


def test_readme(rover: Path) -> None:
    space = run("README.md", HOUSE)
    f, model = space["f"], space["model"]
    assert f(model.x0, [1.0, 1.0], model.p).shape == (len(model.states), 1)
    assert "actuator_lag" in str(model.parameters)


def test_python(rover: Path) -> None:
    space = run("python.md")
    assert space["diagnosis"].verdict == "effects"
    assert {p.name for p in (rover / "out").iterdir()} >= {"diagnosis.json", "model.json", "report.html"}
    assert space["opti"].ng == 20 * len(space["model"].states)


def test_compare(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_sets(tmp_path, track=1.1)
    monkeypatch.chdir(tmp_path)
    space = run("compare.md")
    assert space["found"].verdict == "changed" and list(space["table"].effect) == ["track_width"]
    assert {p.name for p in (tmp_path / "out").iterdir()} == {"comparison.json", "report.html"}


def test_the_defaults_of_a_comparison_are_those_of_the_page() -> None:
    page = text(DOCS / "reference" / "comparison.md")
    told = re.findall(r"^\| `([a-z_.]+)` \| ([0-9.]+) \|", page, flags=re.M)
    assert {name for name, _ in told} >= {"contrast.unit", "contrast.level", "search.most", "sure"}
    for name, value in told:
        assert float(value) == attrgetter(name)(ComparisonSettings()), name


def test_controllers(rover: Path) -> None:
    space = run("closed-loop.md")
    assert space["path"].shape == (100, 3) and {"mpc", "lqr"} <= set(space)
    assert space["result"]["controllers"]["nominal"]["tracking_rmse"] < 0.05
    assert space["error"][-1] < 0.05


def test_simulator(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "arm.xml").write_text(arm_xml(SERVOS))
    (tmp_path / "robot.toml").write_text('name = "arm"\nplant = "mujoco"\nmodel = "arm.xml"\n')
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "model.json").write_text(
        '{"schema": "residual-mpc/model/1", "robot": "arm", "robot_file": "../robot.toml", "values": '
        '[{"effect": "viscous_friction", "target": null, "parameter": "coefficient", "value": 0.05}]}'
    )
    monkeypatch.chdir(tmp_path)
    space = run("simulator.md")
    first, again = space["seen"]["position.j1"], space["again"]["position.j1"]
    assert first.shape == (256,) and np.array_equal(first, again)


def test_own_arm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "arm.xml").write_text(arm_xml(SERVOS))
    (tmp_path / "arm.toml").write_text('name = "arm"\nplant = "mujoco"\nmodel = "arm.xml"\n')
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "model.json").write_text(
        '{"schema": "residual-mpc/model/1", "robot": "arm", "robot_file": "../arm.toml", "values": '
        '[{"effect": "actuator_lag", "target": null, "parameter": "time_constant", "value": 0.08}]}'
    )
    monkeypatch.chdir(tmp_path)
    space = run("own-arm.md")
    assert set(space["result"]["controllers"]) == {"nominal", "augmented"}
    assert space["info"].outcome == "solved" and space["careful"].settings.limits.rate == 1.0


def test_policy_transfer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The situations' own robots, with a diagnosis as their how-to page has it."""
    situations = runpy.run_path(str(DOCS / "examples" / "situations.py"))
    assert situations["main"]("policy", tmp_path) == {"delay": 0.04, "friction": 0.5}
    late = {"effect": "command_delay", "target": None}
    written = {
        "schema": "residual-mpc/model/1", "robot": "policy", "robot_file": "../robot.toml",
        "explanation": [{**late, "parameters": {"delay": {"ci95": [0.0396, 0.0414], "unit": "s"}}}],
        "values": [{**late, "parameter": "delay", "value": 0.04}],
    }  # fmt: skip
    (tmp_path / "out").mkdir()
    for name in ("model.json", "diagnosis.json"):
        (tmp_path / "out" / name).write_text(json.dumps(written))
    monkeypatch.chdir(tmp_path)
    space = run("policy-transfer.md", DOCS / "howto")
    assert "command_delay None delay randomise from 0.0396 0.0414 s" in capsys.readouterr().out
    assert {len(v) for v in space["seen"].values()} == {64}


@pytest.mark.parametrize(("situation", "columns"), [("servo", 3), ("payload", 7), ("drift", 6)])
def test_a_situation_writes_a_robot_and_logs_that_fit(situation: str, columns: int, tmp_path: Path) -> None:
    import residual_mpc as rm

    runpy.run_path(str(DOCS / "examples" / "situations.py"))["main"](situation, tmp_path)
    robot = rm.load_robot(tmp_path / "robot.toml")
    runs = rm.read_runs(robot, [tmp_path / f"run{k}.csv" for k in (1, 2, 3)])
    assert len(runs.names) == 3 and not [f for f in runs.findings if f.severity == "error"]
    assert len((tmp_path / "run1.csv").read_text().partition("\n")[0].split(",")) == columns
    assert rm.measure_gap(robot, runs).document["nominal"] > 1.5 * rm.measure_gap(robot, runs).document["noise_floor"]


def test_own_robot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copy(HOUSE / "tests" / "contracts" / "cart_plant.py", tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    made = run("your-own-model.md")
    assert made["my_robot"].actuators == ("motor",)
    assert made["x"][0] == pytest.approx(0.3, abs=1e-3)  # in spite of the dead time


def test_the_rows_of_several_topics_become_one_table(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "drive1").mkdir()
    for place, name in enumerate(("cmd_vel", "odom", "joint_states")):
        rows = "".join(f"{0.1 * k + 0.01 * place},{k}\n" for k in range(3))
        (tmp_path / "drive1" / f"{name}.csv").write_text(f"__time,/{name}/value\n{rows}")
    monkeypatch.chdir(tmp_path)
    run("logs.md")
    written = [line.split(",") for line in (tmp_path / "drive1.csv").read_text().splitlines()]
    assert written[0] == ["__time", "/cmd_vel/value", "/odom/value", "/joint_states/value"]
    assert [row[0] for row in written[1:4]] == ["0.0", "0.01", "0.02"] and written[1][2] == ""


def test_own_effect(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "own_effects.py").write_text(blocks(GUIDE / "your-own-effect.md")[0])
    monkeypatch.syspath_prepend(str(tmp_path))
    assert run("your-own-effect.md")["SOFT"].name == "soft_command"


def anchor(heading: str) -> str:
    """As GitHub and MkDocs make it of a heading."""
    return re.sub(r"\s+", "-", re.sub(r"[^\w\s-]", "", heading).strip().lower())


def anchors(page: Path) -> set[str]:
    plain = re.sub(r"^```.*?^```", "", text(page), flags=re.S | re.M)
    return {anchor(h) for h in re.findall(r"^#+ (.*)$", plain, flags=re.M)}


def links(page: Path) -> Iterator[tuple[Path, str]]:
    """(file, anchor) of each relative link."""
    for link in re.findall(r"\]\(([^)\s]+)\)", text(page)):
        if "://" not in link:
            path, _, at = link.partition("#")
            yield (page.parent / path).resolve() if path else page, at


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(HOUSE)))
def test_links_lead_somewhere(page: Path) -> None:
    broken = [
        (str(target), at)
        for target, at in links(page)
        if not target.exists() or (at and target.suffix == ".md" and at not in anchors(target))
    ]
    assert not broken


def test_a_page_belongs_to_one_part_and_is_in_the_menu() -> None:
    pages = {p.relative_to(DOCS).as_posix() for p in DOCS.rglob("*.md")}
    assert {p.split("/")[0] for p in pages - {"index.md", "gallery.md"}} == set(PARTS)
    assert pages == set(re.findall(r": (\S+\.md)$", text(HOUSE / "mkdocs.yml"), flags=re.M))


def test_every_effect_is_listed_with_its_parameters_and_units() -> None:
    from residual_mpc.effects.laws import KINDS
    from residual_mpc.effects.library import LIBRARY

    text = (DOCS / "reference" / "effects.md").read_text(encoding="utf-8")
    rows: dict[str, str] = {}
    for name, parameters in re.findall(r"^\| `(\w+)` \|([^|]*)\|", text, re.MULTILINE):
        rows.setdefault(name, parameters)  # the first table has them all
    for effect in LIBRARY:
        for parameter in effect.parameters:
            unit = "" if parameter.unit == "1" else parameter.unit
            assert f"`{parameter.name}`" in rows[effect.name] and unit in rows[effect.name], (effect.name, parameter)
    for kind in KINDS:
        assert f"`{kind.name}`" in text or f"`{kind.name.removeprefix('fitted_law')}`" in text, kind.name


def test_a_page_of_a_notebook_has_its_cells() -> None:
    """A stale page: make it again with `python -m benchmarks.notebook_pages`."""
    from benchmarks.notebook_pages import PAGES as RENDERED
    from benchmarks.notebook_pages import SOURCE, page_of

    nbformat = pytest.importorskip("nbformat", reason="needs the extra `test`")
    notebooks = sorted(SOURCE.glob("*.ipynb"))
    assert {p.stem for p in notebooks} == {p.stem for p in RENDERED.glob("*.md")}
    for path in notebooks:
        page, at = text(RENDERED / f"{path.stem}.md"), 0
        for part in page_of(nbformat.read(path, as_version=4), path.stem, None).strip().split("\n\n"):
            at = page.find(part, at)
            assert at >= 0, f"{path.stem}: {part}"


def test_the_gallery_shows_every_exhibit() -> None:
    from benchmarks.gallery import EXHIBITS

    page = text(DOCS / "gallery.md")
    assert set(re.findall(r"\{report: (\w+)\}", page)) == set(EXHIBITS)
    assert set(re.findall(r"\(gallery/(\w+)\.webp\)", page)) == set(EXHIBITS)


def test_a_whole_report_is_linked_only_where_it_was_made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(DOCS))
    import hooks

    (tmp_path / "made").mkdir()
    (tmp_path / "made" / "rover.html").write_text("whole")
    monkeypatch.setattr(hooks, "MADE", tmp_path / "made")
    shown = hooks.on_page_markdown("{report: rover} and {report: husky}")
    assert 'href="gallery/rover.html"' in shown and "husky" not in shown
    hooks.on_post_build({"site_dir": str(tmp_path / "site")})
    assert [p.read_text() for p in (tmp_path / "site" / "gallery").iterdir()] == ["whole"]


def test_messages_and_comments_name_pages_that_exist() -> None:
    named = {
        (path.relative_to(HOUSE).as_posix(), page)
        for folder in ("residual_mpc", "plants", "controllers", "scenarios", "benchmarks", "notebooks")
        for path in (HOUSE / folder).rglob("*")
        if path.suffix in (".py", ".ipynb", ".html")
        for page in re.findall(r"docs/[\w/-]+\.md", text(path))
    }
    assert named and not [n for n in named if not (HOUSE / n[1]).is_file()]
