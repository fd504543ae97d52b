"""The drafted robot file put to the test: it has to load, and its runs are audited as `check` would."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from residual_mpc.errors import BadInput
from residual_mpc.init.columns.guess import LogCorrection
from residual_mpc.init.mended_logs import write_corrected_logs
from residual_mpc.logs.audit import audit
from residual_mpc.logs.finding import Finding
from residual_mpc.logs.mended import mended
from residual_mpc.logs.readers.read import read_runs
from residual_mpc.models.facts import check_columns, facts_of
from residual_mpc.models.load import load_robot
from residual_mpc.models.robot_file import RobotFile, read_robot_file


@dataclass(frozen=True)
class Trial:
    """findings: warnings and errors of the runs, as they are once mended."""

    findings: tuple[Finding, ...]

    @property
    def errors(self) -> tuple[Finding, ...]:
        return tuple(f for f in self.findings if f.severity == "error")


def try_robot(text: str, folder: Path, paths: Sequence[str | Path], mends: Sequence[LogCorrection]) -> Trial:
    """Load a robot file that would lie in `folder`, and audit its runs with the mends made.

    Raises BadInput where the robot does not load, whatever the runs; what is wrong with the runs is a finding.
    """
    here = folder if folder.is_dir() else None
    with tempfile.TemporaryDirectory() as scratch:
        robot = _load(text, here, folder)
        model = load_robot(robot)
        try:
            tables = write_corrected_logs(paths, mends, Path(scratch)) if mends else paths
            result = read_runs(tables, robot)
            runs, mends_made = mended(result.runs, [model.channels] * len(result.runs))
            check_columns(runs, [model] * len(runs))
        except BadInput as fault:
            where = fault.where.replace(scratch, "")
            return Trial((Finding("error", "table", "", where, None, fault.what, fault.remedy),))
        findings = (*result.findings, *mends_made, *audit(runs, facts_of(model)))
    return Trial(tuple(f for f in findings if f.severity != "info"))


def _load(text: str, here: Path | None, folder: Path) -> RobotFile:
    """The robot file read as if it lay in `folder`, which may not be there yet."""
    if here is None:
        raise BadInput("folder not found", str(folder), "create it, or choose another with --out")
    try:
        with tempfile.NamedTemporaryFile("w", encoding="utf-8", dir=here, suffix=".toml", delete=False) as part:
            part.write(text)
    except OSError as fault:
        what = f"cannot be written: {fault.strerror}"
        raise BadInput(what, str(folder), "choose another folder with --out") from fault
    try:
        return read_robot_file(part.name)
    finally:
        Path(part.name).unlink()
