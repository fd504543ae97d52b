"""The draft as a robot file, with the reason of every guess beside it."""

from __future__ import annotations

import json
import os
import textwrap
from collections.abc import Iterable
from math import isfinite
from pathlib import Path

from residual_mpc.init.columns.guess import Guess
from residual_mpc.init.draft import Draft
from residual_mpc.models.actuators import Actuator

WIDTH = 118


def robot_file_text(draft: Draft, folder: Path) -> str:
    """The TOML of a draft, for a file in `folder`."""
    lines = ["# Drafted by `residual-mpc init`: every entry is a guess, with its confidence and the reason."]
    if draft.mends:
        lines.append("# Corrections that must be made in the log (`--mended DIR` writes corrected copies):")
        lines += [line for mend in draft.mends for line in _comment(str(mend), "#   ")]
    guesses = {g.what: g for g in draft.guesses}
    said: set[str] = set()

    def why(what: str) -> list[str]:
        said.add(what)
        return _comment(_reason(guesses[what])) if what in guesses else []

    lines += ["", f"name = {_text(draft.name)}", f"plant = {_text(draft.plant)}"]
    if draft.model is not None:
        lines.append(f"model = {_text(_relative(draft.model, folder))}")
    for key, value in (("payload_site", draft.payload_site), ("pose_body", draft.pose_body)):
        if value is not None:
            lines += [*why(key), f"{key} = {_text(value)}"]
    if draft.held:
        lines += [*why("held"), f"held = [{', '.join(map(_text, draft.held))}]"]
    if draft.tunable:
        lines += [*why("tunable"), f"tunable = [{', '.join(map(_text, draft.tunable))}]"]
    if draft.parameters:
        lines += ["", "[parameters]"]
        for key, number in draft.parameters.items():
            lines += [*why(f"parameters.{key}"), f"{key} = {number:.6g}"]
    if draft.log:
        lines += ["", "[log]"]
        for name, column in draft.log.items():
            lines += [*why(name), f"{_text(name)} = {_text(column)}"]
    for joint, actuator in draft.actuators.items():
        lines += ["", f"[actuator.{_key(joint)}]"]
        for key, value in _entries(actuator):
            lines += [*why(f"actuator.{joint}.{key}"), f"{key} = {value}"]
    for setting in draft.settings:
        what = f"model of the runs {setting.runs}"
        lines += ["", "[[variant]]", f"runs = {_text(setting.runs)}"]
        lines += [*why(what), f"model = {_text(_relative(setting.model, folder))}"]
    rest = [g for g in draft.guesses if g.what not in said]
    if rest:
        lines += ["", "# Other guesses, which need no entry in this file:"]
        lines += [line for g in rest for line in _comment(str(g), "#   ")]
    for title, items in (("No column found for:", draft.missing), ("Unused columns:", draft.unmatched)):
        if items:
            lines += ["", f"# {title}"]
            lines += [line for item in items for line in _comment(f"{item.name}: {item.why}", "#   ")]
    return "\n".join(lines) + "\n"


def _reason(guess: Guess) -> str:
    rivals = f"; or {' or '.join(guess.rivals)}" if guess.rivals else ""
    return f"{guess.sure:.0%}: {guess.why}{rivals}"


def _comment(text: str, head: str = "# ") -> list[str]:
    plain = "".join(c if c.isprintable() else "?" for c in text)
    indent = head + ("  " if head != "# " else "")
    return textwrap.wrap(plain, WIDTH, initial_indent=head, subsequent_indent=indent, break_long_words=False)


def _entries(actuator: Actuator) -> Iterable[tuple[str, str]]:
    yield "kind", _text(actuator.kind)
    for key in ("kp", "kv"):
        if getattr(actuator, key) > 0.0:
            yield key, f"{getattr(actuator, key):g}"
    if actuator.gear != 1.0:
        yield "gear", f"{actuator.gear:g}"
    if isfinite(actuator.limit):
        yield "limit", f"{actuator.limit:g}"


def _relative(path: Path, folder: Path) -> str:
    """Seen from the robot file's folder; as a whole where there is no way (another drive)."""
    try:
        return Path(os.path.relpath(path.resolve(), folder.resolve())).as_posix()
    except ValueError:
        return path.resolve().as_posix()


def _text(value: str) -> str:
    """A TOML basic string, which JSON's are."""
    return json.dumps(value, ensure_ascii=False)


def _key(name: str) -> str:
    return name if name.replace("_", "").replace("-", "").isalnum() and name.isascii() else _text(name)
