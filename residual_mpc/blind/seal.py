"""Seals: an answer is committed to before anyone diagnoses, and checked when it is revealed.

The commitment is SHA-256 over a secret salt and the answer's canonical JSON, which holds the digest of the
case's files too, so that neither the answer nor the data can be changed afterwards. Without the salt the
commitment says nothing, even about an answer that is easily guessed.
"""

from __future__ import annotations

import hashlib
import json
import secrets
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from residual_mpc.blind.records import Answer, answer_from
from residual_mpc.errors import BadInput
from residual_mpc.files import write_atomically


@dataclass(frozen=True)
class Sealed:
    """An answer with what is needed to prove that it was fixed beforehand."""

    answer: Answer
    data: str  # hex digest of the case's files
    salt: str  # hex, 32 bytes

    @property
    def commitment(self) -> str:
        """The public hash, hex."""
        text = json.dumps({"answer": self.answer.document(), "data": self.data}, sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(bytes.fromhex(self.salt) + text.encode()).hexdigest()


def seal(answer: Answer, case: Path) -> Sealed:
    """``answer``, sealed to the files in the folder ``case`` under a fresh salt."""
    # the salt must be unguessable, so it comes from the system and not from the case's generator
    return Sealed(answer, digest(case), secrets.token_hex(32))


def digest(case: Path) -> str:
    """Hex SHA-256 over the names and contents of all files under ``case``."""
    total = hashlib.sha256()
    for path in sorted(p for p in case.rglob("*") if p.is_file()):
        content = hashlib.sha256(path.read_bytes()).hexdigest()
        total.update(f"{path.relative_to(case).as_posix()} {content}\n".encode())
    return total.hexdigest()


def write_sealed(sealed: Sealed, path: Path) -> None:
    """Keep ``sealed`` for the day it is revealed."""
    document = {"answer": sealed.answer.document(), "data": sealed.data, "salt": sealed.salt}
    write_atomically(path, json.dumps(document, indent=1) + "\n")


def read_sealed(path: Path) -> Sealed:
    """The sealed answer kept in ``path``; ``BadInput`` where there is none."""
    try:
        document: dict[str, Any] = json.loads(path.read_text())
        return Sealed(answer_from(document["answer"]), str(document["data"]), str(document["salt"]))
    except FileNotFoundError:
        raise BadInput(
            "the answer is missing", str(path), "give the folder of answers that `blind make` wrote"
        ) from None
    except (ValueError, KeyError, TypeError) as error:
        raise BadInput(f"not a sealed answer ({error!r})", str(path), "make the suite again") from None


def reveal(path: Path, commitment: str, case: Path) -> Answer:
    """The answer in ``path``, if it is the one committed to and the data are untouched; else ``BadInput``."""
    sealed = read_sealed(path)
    if sealed.commitment != commitment:
        raise BadInput("the answer does not match its commitment", str(path), "make the suite again")
    if digest(case) != sealed.data:
        raise BadInput("the files of this case have changed since they were sealed", str(case), "make the suite again")
    return sealed.answer
