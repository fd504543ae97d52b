"""Files that appear whole or not at all."""

import os
import tempfile
from pathlib import Path

from residual_mpc.errors import BadInput


def write_atomically(path: Path, text: str) -> None:
    """Write `text` beside `path`, then rename: a reader, or a kill halfway, finds the old file or the new one.

    Makes the folder where there is none. Raises BadInput where the file cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        part = tempfile.NamedTemporaryFile("w", encoding="utf-8", dir=path.parent, suffix=".part", delete=False)
        try:
            with part:
                part.write(text)
            os.chmod(part.name, 0o644)  # a temporary file is its owner's alone; a result is there to be passed on
            os.replace(part.name, path)
        except BaseException:
            Path(part.name).unlink(missing_ok=True)
            raise
    except OSError as error:
        raise BadInput(f"cannot be written: {error.strerror}", str(path), "choose another folder with --out") from error
