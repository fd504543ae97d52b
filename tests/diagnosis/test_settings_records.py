"""What tunes the method is passed down from the caller of `diagnose`, and its records check themselves."""

from __future__ import annotations

import ast
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import pytest

import residual_mpc.diagnosis
from residual_mpc.diagnosis.data.settings import HoldOutSettings
from residual_mpc.diagnosis.options import Options
from residual_mpc.diagnosis.predict.settings import ToleranceSettings
from residual_mpc.diagnosis.search.settings import SearchSettings

FOLDER = Path(residual_mpc.diagnosis.__file__).parent
NAME = "residual_mpc.diagnosis."


def module(path: Path) -> str:
    return ".".join(path.relative_to(FOLDER).with_suffix("").parts)


TREES = {module(p): ast.parse(p.read_text(encoding="utf-8")) for p in FOLDER.rglob("*.py")}


def settings_parameter(function: ast.FunctionDef) -> str | None:
    """The name of the parameter that holds a settings record of the diagnosis."""
    for a in [*function.args.args, *function.args.kwonlyargs]:
        kind = "" if a.annotation is None else ast.unparse(a.annotation)
        if kind.endswith("Settings") and kind != "Settings":  # that one holds the rows of a model
            return a.arg
    return None


TUNED = {
    (m, f.name): p
    for m, t in TREES.items()
    for f in t.body
    if isinstance(f, ast.FunctionDef) and (p := settings_parameter(f))
}


def calls(name: str) -> list[tuple[ast.Call, tuple[str, str]]]:
    """The calls in a module, each with the function that is meant."""
    tree = TREES[name]
    known = {f.name: (name, f.name) for f in tree.body if isinstance(f, ast.FunctionDef)}
    for n in ast.walk(tree):
        if isinstance(n, ast.ImportFrom) and n.module and n.module.startswith(NAME):
            known |= {a.asname or a.name: (n.module.removeprefix(NAME), a.name) for a in n.names}
    return [
        (n, known[n.func.id])
        for n in ast.walk(tree)
        if isinstance(n, ast.Call) and isinstance(n.func, ast.Name) and n.func.id in known
    ]


def test_no_function_of_the_diagnosis_falls_back_on_default_settings() -> None:
    assert len(TUNED) > 100
    missing = []
    for name in TREES:
        for call, function in calls(name):
            given = {k.arg for k in call.keywords}
            positions = [a.arg for f in TREES.get(function[0], ast.Module([], [])).body
                         if isinstance(f, ast.FunctionDef) and f.name == function[1] for a in f.args.args]  # fmt: skip
            if function in TUNED and TUNED[function] not in {*given, *positions[: len(call.args)]}:
                missing.append(f"{name}:{call.lineno} {function[1]}")
    assert missing == []


def test_settings_are_built_in_signatures_and_records_alone() -> None:
    built = []
    for name, tree in TREES.items():
        for f in ast.walk(tree):
            if isinstance(f, ast.FunctionDef):
                inside = [n for statement in f.body for n in ast.walk(statement)]
                built += [
                    f"{name}:{n.lineno}"
                    for n in inside
                    if isinstance(n, ast.Call) and isinstance(n.func, ast.Name) and n.func.id.endswith("Settings")
                    and n.func.id != "Settings"
                ]  # fmt: skip
    assert built == []


def records(record: Any) -> list[Any]:
    below = [getattr(record, f.name) for f in fields(record)]
    return [record, *(r for x in below if is_dataclass(x) for r in records(x))]


def test_every_record_of_the_options_is_frozen() -> None:
    found = records(Options())
    assert len(found) > 25
    for record in found:
        first = fields(record)[0].name
        with pytest.raises(AttributeError):
            setattr(record, first, getattr(record, first))


@pytest.mark.parametrize(
    ("record", "change"),
    [
        (HoldOutSettings(), {"share": 1.5}),
        (HoldOutSettings(), {"every": 0}),
        (ToleranceSettings(), {"levels": (0.1, 0.2)}),
        (SearchSettings(), {"beam": 0}),
    ],
)
def test_a_value_that_makes_no_sense_is_refused(record: Any, change: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=next(iter(change))):
        replace(record, **change)


def test_thresholds_without_tolerances_are_the_callers_own() -> None:
    mine = SearchSettings()
    strict = replace(mine, unmarginalised=replace(mine.unmarginalised, beyond_doubt=99.0)).without_tolerances()
    assert strict.beyond_doubt == 99.0 and strict.beam == mine.beam
