"""Runs in different units are refused with both files: one robot file cannot describe them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from init.arm_logs import mjcf, simulate, write

from residual_mpc.errors import BadInput
from residual_mpc.init.draft import draft

POSITIONS = ["position.shoulder", "position.elbow"]
ANGLES = [*POSITIONS, "velocity.shoulder", "velocity.elbow", "command.shoulder", "command.elbow"]
DEG = 180.0 / np.pi
Tables = list[pd.DataFrame]


@pytest.fixture(scope="module")
def recorded() -> Tables:
    return [simulate(seconds=12.0, seed=k) for k in range(3)]


def written(folder: Path, tables: Tables, limited: bool = True) -> list[Path]:
    xml = mjcf()
    (folder / "arm.xml").write_text(xml if limited else xml.replace('range="-2.5 2"', 'limited="false"'))
    return [write(folder, table, f"run{k}.csv") for k, table in enumerate(tables)]


def scaled(table: pd.DataFrame, columns: list[str], factor: float = DEG) -> pd.DataFrame:
    return table.assign(**{c: factor * table[c] for c in columns})


@pytest.mark.parametrize("columns", [ANGLES, POSITIONS])
def test_degrees_in_one_run_are_refused(tmp_path: Path, recorded: Tables, columns: list[str]) -> None:
    paths = written(tmp_path, [recorded[0], scaled(recorded[1], columns), recorded[2]])
    with pytest.raises(BadInput, match=r"'position\.shoulder' appears to be in deg here and in rad in .*run0\.csv"):
        draft(tmp_path / "arm.xml", paths)


@pytest.mark.parametrize("factor", [1e3, 1e9])
def test_milliseconds_in_one_run_are_refused(tmp_path: Path, recorded: Tables, factor: float) -> None:
    paths = written(tmp_path, [recorded[0], recorded[1].assign(t=factor * recorded[1]["t"]), recorded[2]])
    with pytest.raises(BadInput, match=r"a step of 't' is 1e?.* here and 0\.01 in .*run0\.csv: the units differ"):
        draft(tmp_path / "arm.xml", paths)


def test_a_slower_log_has_no_other_unit(tmp_path: Path, recorded: Tables) -> None:
    thinned = [recorded[0], recorded[1].iloc[::20].reset_index(drop=True), recorded[2]]
    assert draft(tmp_path / "arm.xml", written(tmp_path, thinned)).mends == ()


def test_a_run_may_lack_a_column(tmp_path: Path, recorded: Tables) -> None:
    tables = [recorded[0], recorded[1].drop(columns="velocity.elbow"), recorded[2]]
    assert draft(tmp_path / "arm.xml", written(tmp_path, tables)).mends == ()


def calmer(table: pd.DataFrame, share: float, about_zero: bool) -> pd.DataFrame:
    """The same run with a share of its motion, and the sensors' own noise."""
    rng, out = np.random.default_rng(0), table.copy()
    noise = {"position": 1e-3, "velocity": 1e-2, "command": 0.0}
    for c in ANGLES:
        middle = 0.0 if about_zero or c.startswith("velocity") else float(table[c].iloc[0])
        sigma = noise[c.split(".")[0]]
        out[c] = middle + share * (table[c] - middle) + sigma * rng.standard_normal(len(table))
    return out


@pytest.mark.parametrize("limited", [True, False])
@pytest.mark.parametrize("about_zero", [True, False])
@pytest.mark.parametrize("share", [0.01, 0.025, 0.06])
def test_a_run_that_hardly_moves_says_nothing_of_units(
    tmp_path: Path, recorded: Tables, share: float, about_zero: bool, limited: bool
) -> None:
    """Where the joints stay within few degrees, degrees look like radians."""
    tables = [recorded[0], calmer(recorded[1], share, about_zero), recorded[2]]
    found = draft(tmp_path / "arm.xml", written(tmp_path, [scaled(t, ANGLES) for t in tables], limited))
    assert {m.column for m in found.mends} >= set(POSITIONS)
