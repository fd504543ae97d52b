"""What a residual network learned, in words: the lines for the terminal, and the reasons that the report also gives."""

from collections.abc import Mapping
from typing import Any

Document = Mapping[str, Any]  # learn.json
NEAR = 0.1  # of the H2 norm: it has converged within a tenth of its final value


def learned_lines(d: Document) -> list[str]:
    """What was learned, line by line."""
    gap, h2 = d["gap"], d["h2_norm"]
    where = "on held-out runs" if gap["on"] == "held_out" else "on the training runs"
    out = [f"gap {gap['before']:.3g} -> {gap['after']:.3g} {where} (noise floor {gap['noise_floor']:.2g})"]
    out += [f"  {c:<24} {g['before']:.3g} -> {g['after']:.3g}" for c, g in gap["channels"].items()]
    norms = {k: "-" if v is None else f"{v:.3g}" for k, v in h2.items()}
    out.append(
        f"  H2 norm {norms['first']} -> {norms['last']}; "
        f"held out {norms['held_out_before']} -> {norms['held_out_after']}"
    )
    out.append(f"  {_outcome(d)}")
    if d["kept"] and (floor := at_the_floor(d)):
        out.append(f"  {floor[:1].lower()}{floor[1:]}")
    for odd in d["turned_over"]:
        out.append(
            f"  run {odd['run']}: {odd['channel']} spans {odd['range']:.3g} rad, but {odd['usual']:.3g} in most runs; "
            "the network does not wrap angles, so learn without such runs"
        )
    if d["condition"]:
        c = d["condition"]
        out.append(
            f"  the earlier residual {earlier_fate(c)}: the measured and the predicted velocities differ by "
            f"{c['with_earlier']:.3g} on average with it, by {c['without']:.3g} without it"
        )
    if d["nothing_earlier"]:
        out.append("  the previous case kept nothing, so this one started without an earlier network")
    if d["left_alone"]:
        out.append(f"  not corrected, since worse on validation windows: {', '.join(d['left_alone'])}")
    if d["worse_on_held_out"]:
        out.append(f"  not corrected, since worse on held-out runs: {', '.join(d['worse_on_held_out'])}")
    return [*out, f"  {d['note']}"]


def _outcome(d: Document) -> str:
    """Whether anything was kept, and how fast it was learned."""
    if not d["kept"]:
        return f"nothing that was learned was kept: {why_nothing(d)}"
    if d["converged_after"] is None:
        return "the H2 norm did not decrease"
    if hardly_fell(d):
        return f"the H2 norm decreased by less than {NEAR:.0%}"
    return f"converged after {d['converged_after']:.0f} s of data"


def hardly_fell(document: Document) -> bool:
    """Whether the H2 norm fell by so little that the time after which it converged says nothing."""
    h2 = document["h2_norm"]
    return document["converged_after"] is not None and h2["last"] > (1.0 - NEAR) * h2["first"]


def at_the_floor(document: Document) -> str:
    """A statement, without a full stop, that the gap is at the noise floor; empty if it is above the floor."""
    at = document["gap"].get("at_noise_floor") or {}
    if at.get("before"):
        return "The gap was at the noise floor without the network: nothing is left to learn"
    if at.get("after"):
        return "With the network the gap is at the noise floor: nothing more is left to learn"
    return ""


def why_nothing(document: Document) -> str:
    """Why nothing that was learned was kept."""
    gap = document["gap"]
    if gap["at_noise_floor"]["before"]:
        return "the gap is already at the noise floor, so nothing is left to learn"
    if document["chosen_pass"] == 0:
        return "no pass over the data predicts the validation windows better; try more passes"
    where = "held-out runs" if gap["on"] == "held_out" else "the training runs"
    if document["left_alone"] and not document["worse_on_held_out"]:
        where = "validation windows"
    return f"the model predicts {where} better without it"


def earlier_fate(condition: Mapping[str, Any]) -> str:
    """What became of the residual of the previous case."""
    if condition["kept"]:
        return "is kept"
    return f"is set to zero{', since the gap is larger with it' if condition['holds'] else ''}"
