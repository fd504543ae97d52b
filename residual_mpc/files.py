"""Files that appear whole or not at all."""

import json
import os
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from residual_mpc.errors import BadInput


def write_atomically(path: Path, text: str) -> None:
    """Write `text` beside `path`, then rename: a reader, or a kill halfway, finds the old file or the new one.

    Makes the folder where there is none. Raises BadInput where the file cannot be written.
    """
    write_bytes_atomically(path, text.encode())


def write_bytes_atomically(path: Path, content: bytes) -> None:
    """As `write_atomically`."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        part = tempfile.NamedTemporaryFile("wb", dir=path.parent, prefix=f".{path.name}.", suffix=".part", delete=False)
        try:
            with part:
                part.write(content)
            os.chmod(part.name, 0o644)  # a temporary file is its owner's alone; a result is there to be passed on
            os.replace(part.name, path)
        except BaseException:
            Path(part.name).unlink(missing_ok=True)
            raise
    except OSError as error:
        raise BadInput(f"cannot be written: {error.strerror}", str(path), "choose another folder") from error


def write_json(path: Path, document: Mapping[str, Any]) -> None:
    """Write a document of plain lists, dicts, texts and finite numbers as `write_atomically` does."""
    write_atomically(path, json.dumps(document, indent=2, allow_nan=False) + "\n")
