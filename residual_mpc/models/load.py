"""From a robot file to its model: built-in plants and entry points by name, a user's own by module path."""

import difflib
import fnmatch
import importlib
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.metadata import entry_points
from pathlib import Path
from types import ModuleType
from typing import Any

from residual_mpc.errors import BadInput
from residual_mpc.logs.columns import did_you_mean
from residual_mpc.models.motors.tables import check_names
from residual_mpc.models.protocol import Robot
from residual_mpc.models.robot_file import RobotFile

GROUP = "residual_mpc.robots"
_BESIDE: set[Path] = set()  # folders of robot files in which a module was found
REQUIRED = tuple(name for name in vars(Robot) if not name.startswith("_"))


def load_robot(robot: RobotFile) -> Robot:
    """Build the nominal model that the file names.

    Raises BadInput for a plant that does not exist, whose module does not import, or whose factory fails, for states in
    channels that the model does not predict, for a motor of an actuator that the model does not have, and for a pattern
    under `tunable` that matches no parameter.
    """
    factory = _factory(robot)
    try:
        model = factory(robot)
    except BadInput:
        raise
    except Exception as error:  # a user's factory may raise anything; it is their input
        raise BadInput(f"plant {robot.plant!r} failed: {error!r}", robot.source, "fix the factory") from error
    missing = [n for n in REQUIRED if not hasattr(model, n)]
    if missing:
        raise BadInput(
            f"plant {robot.plant!r} returned a {type(model).__name__} without {', '.join(missing)}",
            robot.source,
            "return an object with the members of residual_mpc.models.protocol.Robot",
        )
    unknown = [c for s in model.states for c in (s.position, s.velocity) if c is not None and c not in model.channels]
    if unknown:
        raise BadInput(
            f"plant {robot.plant!r} returned a {type(model).__name__} with states in {', '.join(unknown)}, which are"
            " not among its channels",
            robot.source,
            "add them to `channels` and let `replay` predict them, or give the State no velocity",
        )
    check_names(robot.motors, model.actuators, robot.source)
    _check_tunable(robot, model)
    return model


def _check_tunable(robot: RobotFile, model: Robot) -> None:
    """Raises BadInput for a pattern under `tunable` that no parameter of the model matches."""
    names = list(model.nominal())
    general = [f"{n.split('.')[0]}.*.{n.split('.')[-1]}" if n.count(".") > 1 else n for n in names]
    for pattern in robot.tunable:
        if not any(fnmatch.fnmatchcase(name, pattern) for name in names):
            raise BadInput(
                f"tunable names {pattern!r}, which matches no parameter of the model",
                robot.source,
                did_you_mean(pattern, dict.fromkeys(general) if "*" in pattern else names),
            )


@contextmanager
def _leaving_no_bytecode() -> Iterator[None]:
    """A module in the user's folder leaves no __pycache__ there."""
    before = sys.dont_write_bytecode
    sys.dont_write_bytecode = True
    try:
        yield
    finally:
        sys.dont_write_bytecode = before


def _factory(robot: RobotFile) -> Callable[[RobotFile], Robot]:
    known = {e.name: e for e in entry_points(group=GROUP)}
    if robot.plant in known:
        loaded: Callable[[RobotFile], Robot] = known[robot.plant].load()
        return loaded
    if ":" not in robot.plant:
        near = difflib.get_close_matches(robot.plant, known, n=1)
        raise BadInput(
            f"unknown plant {robot.plant!r}",
            robot.source,
            (f"did you mean {near[0]!r}? " if near else "")
            + f"known plants: {', '.join(sorted(known))}; name your own as package.module:factory",
        )
    return load_factory(robot.plant, robot.source, robot.folder)


def load_factory(path: str, where: str, folder: Path | None = None) -> Callable[..., Any]:
    """The function `package.module:factory` of a user's own module, which may lie in the folder of the robot file.
    Raises BadInput if it cannot be loaded."""
    module, colon, name = path.partition(":")
    if not colon:
        raise BadInput(f"{path!r} is not a factory", where, "give package.module:factory")
    try:
        with _leaving_no_bytecode():
            found = getattr(_imported(module, folder, where), name, None)
    except BadInput:
        raise
    except Exception as error:  # importing a user's module runs their code
        raise BadInput(f"module {module!r} cannot be imported: {error!r}", where, "fix or install it") from error
    if not callable(found):
        raise BadInput(f"module {module!r} has no factory {name!r}", where, "name a function that takes the robot file")
    factory: Callable[..., Any] = found
    return factory


def _imported(module: str, folder: Path | None, where: str) -> ModuleType:
    """The module, from where Python finds it, else from the folder, which then stays where Python looks: processes
    that are started later import it again. Raises BadInput for the module of another robot file's folder."""
    top = module.partition(".")[0]
    beside = None if folder is None else _beside(top, folder.resolve())
    try:
        found = importlib.import_module(module)
    except ModuleNotFoundError as error:
        if error.name != top or beside is None:
            raise
        sys.path.append(str(beside.parent))
        _BESIDE.add(beside.parent)
        importlib.invalidate_caches()
        return importlib.import_module(module)
    whole = sys.modules[top]
    at = next(iter(getattr(whole, "__path__", ())), getattr(whole, "__file__", None))
    loaded = None if at is None else _beside(top, Path(at).resolve().parent)
    if beside is not None and loaded is not None and loaded != beside and loaded.parent in _BESIDE:
        raise BadInput(
            f"the module {top!r} is already loaded from {loaded.parent}, and {beside.parent} has another of that name",
            where, "rename one of them, or load each robot in a process of its own",
        )  # fmt: skip
    return found


def _beside(name: str, folder: Path) -> Path | None:
    """The module or package of this name in a folder."""
    module, package = folder / f"{name}.py", folder / name
    return module if module.is_file() else package if (package / "__init__.py").is_file() else None
