"""Controllers that a model may be put into, by whoever is installed."""

from importlib.metadata import entry_points
from typing import Any

from residual_mpc.errors import BadInput

CONTROLLERS = "residual_mpc.controllers"  # entry points: "mpc" and "lqr"


def controller(name: str) -> Any:
    """What builds a controller, from whoever is installed."""
    found = [e for e in entry_points(group=CONTROLLERS) if e.name == name]
    if not found:
        raise BadInput(f"no controller {name!r} is installed", "", "install the package `controllers`")
    return found[0].load()
