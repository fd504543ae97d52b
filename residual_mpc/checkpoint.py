"""Results of finished steps, kept in a file so that a killed command can resume where it stopped.

Every result is passed on as deserialised, even if it was computed in this process, so that the answer does not depend
on where a command was stopped.
"""

import io
import logging
import os
import pickle
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any, BinaryIO, TypeVar

import numpy as np

from residual_mpc.errors import BadInput
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
    """The steps that were finished under a key; a file with a different key belongs to another computation
    and is overwritten.

    The file grows by a record for each step, and results stay in it: a long diagnosis has hundreds of megabytes of
    them. A record that a kill left incomplete is overwritten by the next.

    Args:
        path: the file; None to keep nothing.
        key: a digest of all that the results depend on.
    """

    def __init__(self, path: Path | None = None, key: str = "") -> None:
        self.path, self.key = path, key
        self._records, self._end = ({}, 0) if path is None else _read(path, key)

    @property
    def last(self) -> str | None:
        """The most recently finished step; None if there is none."""
        return next(reversed(self._records), None)

    def __contains__(self, step: str) -> bool:
        return step in self._records

    def get(self, step: str) -> tuple[bytes, Any]:
        """A step's result, and the state of the generator after it."""
        assert self.path is not None
        record = self._records[step]
        with self.path.open("rb") as stream:
            stream.seek(record.place)
            return stream.read(record.size), record.rng

    def put(self, step: str, blob: bytes, rng: Any) -> None:
        """Keep a step in the file."""
        if self.path is None:
            return
        if not self._records or not self.path.exists():  # of another key, or removed meanwhile
            self._records.clear()
            start = pickle.dumps(self.key)
            write_bytes_atomically(self.path, start)
            self._end = len(start)
        head = pickle.dumps((step, rng, len(blob)))
        try:
            with self.path.open("r+b") as stream:
                stream.seek(self._end)
                stream.truncate()
                stream.write(head)
                stream.write(blob)
        except OSError as error:
            raise BadInput(
                f"cannot be written: {error.strerror}",
                str(self.path),
                "check that it is writable and that the disk is not full",
            ) from error
        self._records[step] = _Record(self._end + len(head), len(blob), rng)
        self._end += len(head) + len(blob)

    def close(self) -> None:
        """The command has finished: remove the file and any partial file left by a kill."""
        if self.path is not None:
            for file in (self.path, *self.path.parent.glob(f".{self.path.name}.*.part")):
                file.unlink(missing_ok=True)


@dataclass(frozen=True)
class _Record:
    """Where the result of a step lies in the file, bytes, and the state of the generator after it."""

    place: int
    size: int
    rng: Any


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
        if step in self.checkpoint:
            blob, state = self.checkpoint.get(step)
            _set_state(self.rng, state)
        else:
            result = compute()
            stream = io.BytesIO()
            _Pickler(stream, self.known, self.replaced).dump(result)
            blob = stream.getvalue()
            self.checkpoint.put(step, blob, _state(self.rng))
            del result
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

    def __init__(self, stream: BinaryIO, known: Sequence[Any] = ()) -> None:
        super().__init__(stream)
        self.known = known

    def persistent_load(self, pid: int) -> Any:
        return self.known[pid]

    def find_class(self, module: str, name: str) -> Any:
        if name in PLAIN.get(module, ()) or (module.split(".")[0] == "numpy" and name in NUMPY):
            return super().find_class(module, name)
        if module.startswith("residual_mpc.") and "." not in name:  # a dotted name may lead to another package
            found = super().find_class(module, name)
            if isinstance(found, type) and found.__module__.startswith("residual_mpc."):
                return found
        raise pickle.UnpicklingError(f"a checkpoint may not hold {module}.{name}")


def _proxy(content: dict[Any, Any]) -> MappingProxyType[Any, Any]:
    return MappingProxyType(content)


def _read(path: Path, key: str) -> tuple[dict[str, _Record], int]:
    """The complete records of a file and where they end; none if its key differs or it cannot be read."""
    records: dict[str, _Record] = {}
    try:
        with path.open("rb") as stream:
            whole = os.fstat(stream.fileno()).st_size
            if _Unpickler(stream).load() != key:
                return {}, 0
            end = stream.tell()
            while end < whole:
                try:
                    step, rng, size = _Unpickler(stream).load()
                except Exception:  # a kill cut it short
                    break
                record = _Record(stream.tell(), int(size), rng)
                end_of_record = stream.seek(record.size, os.SEEK_CUR)
                if end_of_record > whole:
                    break
                records[str(step)], end = record, end_of_record
        return records, end
    except FileNotFoundError:
        return {}, 0
    except Exception as error:  # whatever a damaged file makes of itself
        LOG.warning(f"{path}: this checkpoint cannot be read and is not used ({type(error).__name__})")
        return {}, 0


def _state(rng: np.random.Generator) -> Any:
    """The generator's state, and how many generators it has spawned."""
    seeds = rng.bit_generator.seed_seq
    return rng.bit_generator.state, getattr(seeds, "n_children_spawned", 0)


def _set_state(rng: np.random.Generator, state: Any) -> None:
    rng.bit_generator.state, spawned = state
    missing = spawned - getattr(rng.bit_generator.seed_seq, "n_children_spawned", 0)
    if missing > 0:
        rng.spawn(missing)
