"""Motions as a file that can be played: CSV by the log format."""

from collections.abc import Sequence

from residual_mpc.experiment.motions import Motion


def command_table(motions: Sequence[Motion], actuators: Sequence[str]) -> str:
    """One run a motion; `enabled.*` where any of them switches motors off."""
    many = len(motions) > 1
    switched = any(m.enabled is not None for m in motions)
    header = [*(["run"] if many else []), "t", *(f"command.{a}" for a in actuators)]
    header += [f"enabled.{a}" for a in actuators] if switched else []
    lines = [",".join(header)]
    for m in motions:
        for k, t in enumerate(m.t):
            on = [] if not switched else [1] * len(actuators) if m.enabled is None else m.enabled[k].astype(int)
            cells = [f"{t:.6g}", *(f"{u:.6g}" for u in m.command[k]), *(str(x) for x in on)]
            lines.append(",".join([*([m.name.replace(",", "").replace(" ", "_")] if many else []), *cells]))
    return "\n".join(lines) + "\n"
