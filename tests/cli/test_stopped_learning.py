"""Ctrl-C on `learn` says that the same command continues, where there is something to continue from."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from oracles.rover_log import ROBOT, rover_run, write_run

from residual_mpc.cli.main import main
from residual_mpc.learning.batch.checkpoint import FILE


@pytest.mark.parametrize("begun", [True, False])
def test_a_stopped_command_says_how_to_go_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], begun: bool
) -> None:
    (tmp_path / "rover.toml").write_text(ROBOT)
    write_run(rover_run("r0", {}, 6.0), tmp_path)
    out = tmp_path / "out"

    def stopped(*_: Any, **__: Any) -> None:
        if begun:
            out.mkdir()
            (out / FILE).write_bytes(b"")
        raise KeyboardInterrupt

    monkeypatch.setattr("residual_mpc.api.learning.learn", stopped)
    with pytest.raises(SystemExit) as end:
        main(["learn", "--robot", str(tmp_path / "rover.toml"), str(tmp_path / "r0.csv"), "--out", str(out)])
    told = capsys.readouterr().err
    assert end.value.code == 1 and told.endswith("residual-mpc: stopped\n")
    assert ("run the same command again to continue from the last checkpoint" in told) == begun
