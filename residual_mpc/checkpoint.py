"""Results of finished steps, kept in a file so that a command that was killed goes on where it was.

A step's result is passed on as it is read back, whether or not it was computed in this process: an answer does not
depend on where a command was stopped.
"""

import io
import logging
import pickle
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar

import numpy as np

from residual_mpc.files import write_bytes_atomically

LOG = logging.getLogger(__name__)
T = TypeVar("T")
PLAIN = {  # what a checkpoint may hold beside numpy's arrays and this package's classes
    "builtins": {"slice", "set", "frozenset", "complex", "bytearray"},
    "collections": {"OrderedDict"},
    "residual_mpc.checkpoint": {"_proxy"},
}
NUMPY = {"_reconstruct", "scalar", "ndarray", "dtype", "_frombuffer"}

Replacement = Callable[[Any], Any]  # an object -> what __reduce__ would give, NotImplemented where nothing is replaced


class Checkpoint:
    """The steps that were finished under a key; a file under another key is of something else, and is overwritten.

    Args:
        path: the file; None to keep nothing.
        key: a digest of all that the results depend on.
    """

    def __init__(self, path: Path | None = None, key: str = "") -> None:
        self.path, self.key = path, key
        self.steps: dict[str, tuple[bytes, Any]] = {} if path is None else _read(path, key)

    @property
    def last(self) -> str | None:
        """The last step that was finished before, None for none."""
        return next(reversed(self.steps), None)

    def put(self, step: str, blob: bytes, rng: Any) -> None:
        """Keep a step, in the file as well."""
        self.steps[step] = (blob, rng)
        if self.path is not None:
            write_bytes_atomically(self.path, pickle.dumps({"key": self.key, "steps": self.steps}))

    def close(self) -> None:
        """The command is through: remove the file, and what a kill left of one."""
        if self.path is not None:
            for file in (self.path, *self.path.parent.glob(f".{self.path.name}.*.part")):
                file.unlink(missing_ok=True)


@dataclass(frozen=True, eq=False)
class Keeper:
    """Runs steps, or takes them from a checkpoint.

    known: objects that every run has, such as its robot: steps refer to them instead of holding copies. replaced: for
    objects to be kept in another form.
    """

    checkpoint: Checkpoint
    rng: np.random.Generator
    known: Sequence[Any] = ()
    replaced: Replacement = field(default=lambda thing: NotImplemented)

    def __call__(self, step: str, compute: Callable[[], T]) -> T:
        """The result of a step; the generator is left as the step leaves it."""
        if step in self.checkpoint.steps:
            blob, state = self.checkpoint.steps[step]
            _set_state(self.rng, state)
        else:
            result = compute()
            stream = io.BytesIO()
            _Pickler(stream, self.known, self.replaced).dump(result)
            blob = stream.getvalue()
            self.checkpoint.put(step, blob, _state(self.rng))
        loaded: T = _Unpickler(io.BytesIO(blob), self.known).load()
        return loaded


def at_once(step: str, compute: Callable[[], T]) -> T:
    """A keeper that keeps nothing."""
    return compute()


class _Pickler(pickle.Pickler):
    def __init__(self, stream: io.BytesIO, known: Sequence[Any], replaced: Replacement) -> None:
        super().__init__(stream, protocol=5)
        self.number = {id(thing): n for n, thing in enumerate(known)}
        self.replaced = replaced

    def persistent_id(self, obj: Any) -> int | None:
        return self.number.get(id(obj))

    def reducer_override(self, obj: Any) -> Any:
        return (_proxy, (dict(obj),)) if isinstance(obj, MappingProxyType) else self.replaced(obj)


class _Unpickler(pickle.Unpickler):
    """Reads data, and calls nothing but the constructors of records: a file from elsewhere cannot run code."""

    def __init__(self, stream: io.BytesIO, known: Sequence[Any] = ()) -> None:
        super().__init__(stream)
        self.known = known

    def persistent_load(self, pid: int) -> Any:
        return self.known[pid]

    def find_class(self, module: str, name: str) -> Any:
        if name in PLAIN.get(module, ()) or (module.split(".")[0] == "numpy" and name in NUMPY):
            return super().find_class(module, name)
        if module.startswith("residual_mpc.") and isinstance(found := super().find_class(module, name), type):
            return found
        raise pickle.UnpicklingError(f"a checkpoint may not hold {module}.{name}")


def _proxy(content: dict[Any, Any]) -> MappingProxyType[Any, Any]:
    return MappingProxyType(content)


def _read(path: Path, key: str) -> dict[str, tuple[bytes, Any]]:
    """The steps in a file, none where it is of something else or cannot be read."""
    try:
        with path.open("rb") as stream:
            content = _Unpickler(io.BytesIO(stream.read())).load()
        return dict(content["steps"]) if content["key"] == key else {}
    except FileNotFoundError:
        return {}
    except Exception as error:  # whatever a damaged file makes of itself
        LOG.warning(f"{path}: this checkpoint cannot be read and is not used ({type(error).__name__})")
        return {}


def _state(rng: np.random.Generator) -> Any:
    """The generator's state, and how many generators it has spawned."""
    seeds = rng.bit_generator.seed_seq
    return rng.bit_generator.state, getattr(seeds, "n_children_spawned", 0)


def _set_state(rng: np.random.Generator, state: Any) -> None:
    rng.bit_generator.state, spawned = state
    missing = spawned - getattr(rng.bit_generator.seed_seq, "n_children_spawned", 0)
    if missing > 0:
        rng.spawn(missing)
