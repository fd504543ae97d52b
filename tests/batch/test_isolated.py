"""Programs in processes of their own end with the call that waits for them."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from threading import Thread

from residual_mpc.processes.isolated import _RUNNING, ProcessResult, run_isolated, stop_all

SLEEPER = [sys.executable, "-c", "import time; time.sleep(60)"]


def test_what_threads_wait_for_is_stopped(tmp_path: Path) -> None:
    ended: list[ProcessResult] = []
    threads = [Thread(target=lambda: ended.append(run_isolated(SLEEPER, tmp_path, 60.0))) for _ in range(2)]
    for thread in threads:
        thread.start()
    until = time.monotonic() + 20.0
    while len(_RUNNING) < 2 and time.monotonic() < until:
        time.sleep(0.05)
    stop_all()
    for thread in threads:
        thread.join(20.0)
    assert [r.status for r in ended] == ["failed", "failed"] and not _RUNNING


def test_a_program_sees_the_callers_environment_only_where_it_may(tmp_path: Path) -> None:
    told = [sys.executable, "-c", "import os; print(os.environ.get('AMENT_PREFIX_PATH'))"]
    everything = {"AMENT_PREFIX_PATH": "/opt/ros", "PATH": "/usr/bin:/bin"}
    assert run_isolated(told, tmp_path, 20.0, everything).said.strip() == "/opt/ros"
    assert run_isolated(told, tmp_path, 20.0).said.strip() == "None"
