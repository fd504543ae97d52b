"""MuJoCo's own timers, which take a third of a step of a small model."""

import ctypes
from functools import cache
from pathlib import Path

LIBRARIES = ("libmujoco*", "mujoco.dll")  # beside the Python package; on Linux and macOS, on Windows


@cache
def stop_mujoco_timers() -> None:
    """Switch off the timers (`MjData.timer`) of this process, once; states do not depend on them.

    The Python bindings install a clock as MuJoCo's `mjcb_time`, which is read a dozen times a step, and have no call
    that takes it away again: `set_mjcb_time(None)` puts it back. A clock that the user has set stays.
    """
    import mujoco

    if mujoco.get_mjcb_time() is not None:
        return
    for pattern in LIBRARIES:
        for path in Path(mujoco.__file__).parent.glob(pattern):
            ctypes.c_void_p.in_dll(ctypes.CDLL(str(path)), "mjcb_time").value = None
