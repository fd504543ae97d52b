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


@pytest.fixture(scope="module")
def recorded() -> list[pd.DataFrame]:
    return [simulate(seconds=12.0, seed=k) for k in range(3)]


def written(folder: Path, tables: list[pd.DataFrame]) -> list[Path]:
    (folder / "arm.xml").write_text(mjcf())
    return [write(folder, table, f"run{k}.csv") for k, table in enumerate(tables)]


@pytest.mark.parametrize("columns", [ANGLES, POSITIONS])
def test_degrees_in_one_run_are_refused(tmp_path: Path, recorded: list[pd.DataFrame], columns: list[str]) -> None:
    degrees = recorded[1].copy()
    degrees[columns] *= 180.0 / np.pi
    paths = written(tmp_path, [recorded[0], degrees, recorded[2]])
    with pytest.raises(BadInput, match=r"'position\.shoulder' appears to be in deg here and in rad in .*run0\.csv"):
        draft(tmp_path / "arm.xml", paths)


def test_milliseconds_in_one_run_are_refused(tmp_path: Path, recorded: list[pd.DataFrame]) -> None:
    paths = written(tmp_path, [recorded[0], recorded[1].assign(t=1000.0 * recorded[1]["t"]), recorded[2]])
    with pytest.raises(BadInput, match=r"a step of 't' is 10 here and 0\.01 in .*run0\.csv: the units differ"):
        draft(tmp_path / "arm.xml", paths)


def test_a_run_that_hardly_moves_says_nothing_of_units(tmp_path: Path, recorded: list[pd.DataFrame]) -> None:
    """Where the joints stay within a degree, radians and degrees look alike."""
    still = recorded[1].copy()
    still[ANGLES] = still[ANGLES].iloc[0] + 0.01 * (still[ANGLES] - still[ANGLES].iloc[0])
    tables = [recorded[0], still, recorded[2]]
    assert draft(tmp_path / "arm.xml", written(tmp_path, tables)).mends == ()
    degrees = [t.assign(**{c: t[c] * 180.0 / np.pi for c in ANGLES}) for t in tables]
    found = draft(tmp_path / "arm.xml", written(tmp_path, degrees))
    assert {m.column for m in found.mends} >= set(POSITIONS)
