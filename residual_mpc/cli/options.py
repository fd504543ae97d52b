"""The arguments of the Python functions, as the command line calls them."""

import re

# argument -> option; what a message names otherwise in backticks is no argument and stays
OPTIONS = {
    "after": "--after",
    "before": "--before",
    "case": "--case",
    "changed": "--changed",
    "form": "--form",
    "held_out": "--held-out",
    "held_out_of": "--held-out-of",
    "limits": "--limit",
    "on": "--on",
    "only": "--only",
    "out": "--out",
    "plant": "--plant",
    "reference": "--reference",
    "robot": "--robot",
    "runs": "--runs",
    "smooth": "--smooth",
    "step": "--step",
    "to": "--to",
    "video": "--video",
    "warm_start": "--warm-start",
    "weights": "--weights",
    "withheld": "--withheld",
    "without": "--without",
}
ARGUMENT = re.compile(r"`([a-z_]+)(?:=([^`]*))?`")
RANGE = re.compile(r'"([^"]+)": \((\w+), (\w+)\)')  # an entry of a mapping such as {"left": (LOW, HIGH)}


def with_options(message: str) -> str:
    """A message that names arguments, `only` or `to=mjcf`, with the options in their place, --only or --to mjcf."""
    return ARGUMENT.sub(_option, message)


def _option(found: re.Match[str]) -> str:
    name, value = found[1], found[2]
    if name not in OPTIONS:
        return found[0]
    if value is None:
        return OPTIONS[name]
    entries = [f"{key}={low}:{high}" for key, low, high in RANGE.findall(value)] or [value]
    return " ".join(f"{OPTIONS[name]} {entry}" for entry in entries)
