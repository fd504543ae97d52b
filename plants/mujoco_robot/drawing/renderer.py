"""MuJoCo's renderer in a process of its own: it works without a display, and what a graphics driver does to its process
cannot harm a diagnosis."""

import os
import pickle
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from functools import cache
from pathlib import Path

import numpy as np

from plants.mujoco_robot.drawing import worker
from plants.mujoco_robot.drawing.skeleton import positions, skeleton
from plants.mujoco_robot.structure.compiled_robot import CompiledRobot
from residual_mpc.models.drawing import Camera, Motion, NoRenderer, Size

LINUX = ("egl", "osmesa")  # in this order: EGL also uses a GPU, OSMesa needs none
LONGEST = 120.0  # s that a picture may take
FIRST_LOOK = 30.0  # s that an empty picture may take


def shade(robot: CompiledRobot, motions: Sequence[Motion], camera: Camera, size: Size) -> np.ndarray:
    """See residual_mpc.models.drawing.Rendering."""
    task = worker.Task(
        robot.model, np.stack([positions(robot, m) for m in motions]), np.stack([skeleton(robot, m) for m in motions]),
        camera.target, camera.azimuth, camera.elevation, camera.height, size,
    )  # fmt: skip
    return _rendered(task, _backend(), LONGEST)


@cache
def _backend() -> str:
    """The value of MUJOCO_GL that renders here; empty where the system has one way. Raises NoRenderer."""
    import mujoco

    given = os.environ.get("MUJOCO_GL", "")
    tried = []
    for backend in (given,) if given or sys.platform != "linux" else LINUX:
        empty = worker.Task(
            mujoco.MjModel.from_xml_string("<mujoco/>"), np.zeros((1, 1, 0)), np.zeros((1, 1, 0, 2, 3)),
            (0.0, 0.0, 0.0), 0.0, 0.0, 1.0, (8, 8),
        )  # fmt: skip
        try:
            _rendered(empty, backend, FIRST_LOOK)
            return backend
        except NoRenderer:
            tried.append(backend or "the system's OpenGL")
    raise NoRenderer(f"no renderer was found (tried {' and '.join(tried)})")


def _rendered(task: worker.Task, backend: str, seconds: float) -> np.ndarray:
    """Raises NoRenderer where the process fails or takes too long."""
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "LP_NUM_THREADS": "1"}
    if backend:
        environment["MUJOCO_GL"] = backend
        environment.pop("PYOPENGL_PLATFORM", None)  # another backend's, which MuJoCo would refuse
    with tempfile.TemporaryDirectory() as folder:
        asked, made = Path(folder) / "task.pickle", Path(folder) / "shade.npy"
        asked.write_bytes(pickle.dumps(tuple(task)))
        command = [sys.executable, "-P", str(Path(worker.__file__)), str(asked), str(made)]
        try:
            done = subprocess.run(command, env=environment, capture_output=True, timeout=seconds, check=False)
        except (OSError, subprocess.TimeoutExpired) as error:
            raise NoRenderer(f"the renderer was stopped after {seconds:g} s") from error
        if done.returncode or not made.is_file():
            said = done.stderr.decode(errors="replace").strip().splitlines()[-1:]
            raise NoRenderer(f"the renderer failed ({' '.join(said) or f'exit status {done.returncode}'})")
        return np.asarray(np.load(made))
