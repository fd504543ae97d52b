"""Where many calls run: on this machine's cores, or on the workers of a Dask cluster."""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

from residual_mpc.errors import BadInput
from residual_mpc.extras import extra
from residual_mpc.processes.isolated import stop_all
from residual_mpc.processes.parallel import Progress, run_in_parallel

ENGINES = ("processes", "dask")


@dataclass(frozen=True)
class Engine:
    """jobs: calls at once, -1 for all cores; address: of a running Dask scheduler, empty for a local cluster."""

    name: str = "processes"
    jobs: int = -1
    address: str = ""

    def __post_init__(self) -> None:
        if self.name not in ENGINES:
            raise BadInput(f"unknown engine {self.name!r}", "--engine", f"Known engines: {', '.join(ENGINES)}")
        if self.jobs == 0:
            raise BadInput("must be -1 or a number of calls at once, got 0", "--jobs")
        if self.address and self.name != "dask":
            raise BadInput("is of a Dask scheduler", "--address", "add --engine dask")


def run_on(engine: Engine, calls: Sequence[Any], names: Sequence[str], progress: Progress) -> list[Any]:
    """The outcomes of joblib's delayed calls, in their order. Each starts a process of its own: on this machine threads
    only wait for them."""
    if engine.name == "processes":
        try:
            return run_in_parallel(calls, names, progress, n_jobs=engine.jobs, prefer="threads")
        except BaseException:  # Ctrl-C: nothing is to go on behind the next call
            stop_all()
            raise
    if not calls:
        return []
    with extra("dask"):
        from dask.distributed import Client, LocalCluster  # type: ignore[import-not-found, unused-ignore]
    from joblib import parallel_config

    workers = engine.jobs if engine.jobs > 0 else os.cpu_count()
    with ExitStack() as opened:  # a client closes no cluster that it is given
        cluster: Any = engine.address or opened.enter_context(
            LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=None)
        )
        opened.enter_context(Client(cluster))
        opened.enter_context(parallel_config(backend="dask"))
        return run_in_parallel(calls, names, progress)
