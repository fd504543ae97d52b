"""What a model file names, before a robot file says how it is driven: its joints, its actuators, and its torques."""

from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import entry_points
from pathlib import Path

import numpy as np

from residual_mpc.errors import BadInput
from residual_mpc.logs.audit.facts import ActuatorFacts

GROUP = "residual_mpc.model_structures"

Torque = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Joint:
    """One joint of one degree of freedom: rad, N m where it turns; m, N where it slides.

    Attributes:
        name: as in `position.<name>`.
        slides: whether it slides.
        limits: its range, None where it has none.
        effort: the largest torque that the model allows at it, None where it says nothing.
        follows: the joint that it is coupled to (mimic), None where it moves on its own.
    """

    name: str
    slides: bool = False
    limits: tuple[float, float] | None = None
    effort: float | None = None
    follows: str | None = None


@dataclass(frozen=True, eq=False)
class ModelStructure:
    """A compiled model, with or without actuators.

    Attributes:
        plant: the plant that builds robots of such files.
        joints: hinges and slides, in the model's order.
        actuators: empty for a model that declares none, such as a URDF.
        base: the body with a free joint, None for a robot that is fixed to the world.
        sites: names, the outermost body's last.
        torque: (positions, velocities, accelerations), (n, joints) each -> (n, joints) what actuators would have to
            give; None where a free base makes it another question.
    """

    plant: str
    joints: tuple[Joint, ...]
    actuators: tuple[ActuatorFacts, ...] = ()
    base: str | None = None
    sites: tuple[str, ...] = ()
    torque: Torque | None = None


def read_model_structure(path: Path) -> ModelStructure:
    """The structure of a model file, by the first plant that reads such files.

    Raises BadInput where there is no such file, no plant reads it, or it does not compile.
    """
    if not path.is_file():
        came = "must be a model file, got a folder" if path.is_dir() else "model file not found"
        raise BadInput(came, str(path), "give an MJCF or URDF file")
    readers = {e.name: e for e in entry_points(group=GROUP)}
    if not readers:
        raise BadInput("no installed plant reads model files", str(path), "reinstall residual-mpc")
    reader: Callable[[Path], ModelStructure] = readers[min(readers)].load()
    return reader(path)
