"""Diagnoses of recorded robots as a page of Markdown: gaps on runs kept back, causes, and the commands.

python -m benchmarks.recorded [--data ../shared/data] [--row NAME ...] [--keep build/recorded] [--again] [--page FILE]

The recordings are no part of this repository. A row whose folder is absent says so, and the others are
measured. Each row calls the command line as a user would, in a process of its own. A row that was measured with the
same command and the same code is read from --keep, so that a call that was stopped goes on.
"""

from __future__ import annotations

import json
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from importlib.metadata import version
from itertools import pairwise
from pathlib import Path
from statistics import fmean
from time import perf_counter
from typing import Any

import click


@dataclass(frozen=True)
class Row:
    """One line of the page: the command on the runs of `folder`, and what is known of them from elsewhere.

    `mass` (kg), where it is given, replaces the mass in a copy of the model. `true` holds what is known of a
    parameter, by (effect, parameter), in its unit.
    """

    name: str
    folder: str
    what: str
    known: str
    command: str = "diagnose"
    options: tuple[str, ...] = ()
    mass: float | None = None
    true: Mapping[tuple[str, str], float] = field(default_factory=dict)


MOTIONS = (
    "actuator_bandwidth", "boundary_exploration", "center_workspace", "circular_motion", "coupled_joints",
    "custom_motion", "diagonal_sweep", "dual_joint_elbow_wrist", "dual_joint_rotation_pitch", "end_effector",
    "fast_transitions", "frequency_sweep", "gripper_cycles", "hold_under_gravity", "hover_positions",
    "large_amplitude", "oscillation_low_freq", "oscillation_med_freq", "perturbation_test", "prbs_excitation",
    "ramp_motion", "reach_and_return", "reaching_points", "repetitive_motion", "single_joint_rotation",
    "single_joint_wrist_pitch", "single_joint_wrist_roll", "sinusoidal_sweep", "slow_precision",
    "square_pattern", "staircase_motion", "symmetric_motion", "trapezoidal_profile", "triangle_wave",
    "wave_motion",
)  # fmt: skip
ROWS = (
    Row("xl330", "xl330", "one servo swinging 0.49 kg, 4 position gains x 4 motions, all 16 runs",
        "The nominal model has no friction at all. Published fits of the same logs have Coulomb friction of 0.013 N m "
        "with viscous friction of 0.0037 N m s/rad in the simplest model, and load-dependent friction of 0.12 to 0.27 "
        "in richer ones. The observed static stiffness is 0.4 to 0.8 of the nominal one."),
    Row("xl330, half the mass", "xl330", "the same runs, with 0.245 kg in the model in place of 0.49 kg",
        "0.245 kg is missing at the payload site, beside the effects that the row above names.", mass=0.245,
        true={("payload", "mass"): 0.245}),
    Row("xl330, motor off", "xl330",
        "fitted with the motor on throughout, judged on the four runs in which it is mostly off",
        "With the motor off, its gain, limit and delay have no effect: only the effects of the link itself are left.",
        options=("--held-out", "*_lift_and_drop")),
    Row("husky_drive", "husky_drive", "skid-steered base, 402 runs of 2 s",
        "Half of the rows command more than 6.9 rad/s, which the wheels never exceed. The robot turns about 0.38 times "
        "as far as the encoders give (a track 2.6 times as wide), and drives 0.82 times as far.",
        true={("saturation", "limit"): 6.9, ("track_width", "scale"): 2.6}),
    Row("husky_terrain", "husky_terrain", "the same base driven by its wheel speeds, gyro alone, 15 runs",
        "Yaw rate over ideal: flooring 0.68, asphalt 0.58, asphalt_05 alone 0.2."),
    Row("husky_terrain, new ground", "husky_terrain", "fitted on flooring, judged on asphalt",
        "The ground differs from that of the fit: a track of 1 / 0.68 = 1.5 there, 1 / 0.58 = 1.7 here.",
        options=("--held-out", "asphalt_*")),
    Row("so101", "so101", "arm of six servos, 35 motions, 54 min",
        "Nobody knows the cause. The servos of the published model are far too stiff (kp 998 N m/rad, observed 6 to "
        "30). Observed are also 20 to 40 ms of dead time, 60 to 120 ms to 63 % of a step, and an elbow that stands "
        "about 4 degrees off its command. `check` warns of a stop at -1.03 rad in the wrist's roll that the model "
        "lacks. The one motion that meets it was held out, and makes two fifths of the remaining squared gap. In this "
        "diagnosis and those of the four fourths the servos are weak (18 to 32 N m/rad, within the observed range), "
        "with dry friction in shoulder_lift and elbow_flex and friction that falls with the speed. The size of each "
        "friction depends on the fitted motions by a factor of three to six, which is beyond the intervals. Dead time, "
        "lag, play and sag were tried and are not named."),
    *(Row(f"so101, fourth {k + 1}", "so101", f"the same arm, every fourth motion by name held out, from number {k + 1}",
          "Together with the other three fourths, each motion is held out once.",
          options=tuple(f"--held-out={name}" for name in MOTIONS[k::4])) for k in range(4)),
)  # fmt: skip

PICTURED = "so101"  # the row whose stages are drawn beside the page

SOURCES = """\
- `xl330`: github Rhoban/bam, history at af22604, Apache-2.0.
- `husky_drive`: github norlab-ulaval/DRIVE at e158a19, BSD-3-Clause, arXiv 2309.10718.
- `husky_terrain`: github norlab-ulaval/BorealTC at fe64e38, CC0, LaRocque et al., IROS 2024.
- `so101`: github isaac-sim2real/sage at 4ffd262, Apache-2.0; model from TheRobotStudio/SO-ARM100 at fda892c,
  Apache-2.0.
"""


@dataclass(frozen=True)
class Measured:
    """What a row's command printed (None where it failed), how long it took (s), and the command as shown."""

    row: Row
    document: dict[str, Any] | None
    seconds: float
    shown: str
    trouble: str = ""


@click.command()
@click.option("--data", type=click.Path(path_type=Path, file_okay=False), default=Path("../shared/data"),
              show_default=True)  # fmt: skip
@click.option("--row", "names", multiple=True, type=click.Choice([r.name for r in ROWS]), help="[default: all]")
@click.option("--keep", type=click.Path(path_type=Path, file_okay=False), default=Path("build/recorded"),
              show_default=True, help="Folder for the diagnoses and their reports.")  # fmt: skip
@click.option("--again", is_flag=True, help="Measure anew what --keep holds.")
@click.option("--page", type=click.Path(path_type=Path, dir_okay=False), help="[default: stdout]")
def recorded(data: Path, names: tuple[str, ...], keep: Path, again: bool, page: Path | None) -> None:
    """Diagnose the recorded robots and write the page."""
    if not data.is_dir():
        click.echo(f"{data} is absent: there are no recordings to measure on. Name their folder with --data.")
        return
    chosen = [row for row in ROWS if not names or row.name in names]
    rows = [measure(row, data, keep, again) for row in chosen]
    text = document(rows)
    if page is None:
        click.echo(text)
    else:
        page.write_text(text, encoding="utf-8")
        arm = next((m.document for m in rows if m.row.name == PICTURED and m.document is not None), None)
        if arm is not None:
            staged_picture(arm["stages_of_gap"], page.parent / "images" / f"{PICTURED}-staged.png")


def staged_picture(stages: list[dict[str, Any]], path: Path) -> None:
    """The gap after each effect is added, as bars."""
    from matplotlib.figure import Figure

    added = ["nominal", *(f"+ {c['effect'].replace('_', ' ')} {c['target'] or ''}".strip() for c in steps_of(stages))]
    figure = Figure(figsize=(7.2, 0.4 * len(stages) + 0.9), layout="constrained")
    axes = figure.subplots()
    bars = axes.barh(range(len(stages)), [s["gap"] for s in stages], color=["0.6", *["tab:blue"] * (len(stages) - 1)])
    axes.bar_label(bars, fmt="%.3f", padding=3)
    axes.set_yticks(range(len(stages)), added)
    axes.invert_yaxis()
    axes.set_xlabel("gap, all windows")
    axes.margins(x=0.12)
    axes.spines[["top", "right"]].set_visible(False)
    path.parent.mkdir(exist_ok=True)
    figure.savefig(path, dpi=120)


def steps_of(stages: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The effect that each stage adds to the one before."""
    return [next(t for t in after["terms"] if t not in before["terms"]) for before, after in pairwise(stages)]


def measure(row: Row, data: Path, keep: Path, again: bool = False) -> Measured:
    """Run the row's command on its folder, or read what it came to."""
    folder = data / row.folder
    out = keep / re.sub(r"\W+", "-", row.name)
    if not (folder / "robot.toml").is_file():
        return Measured(row, None, 0.0, "", f"{folder} is absent")
    robot = folder / "robot.toml" if row.mass is None else changed(folder, row.mass, out / "model")
    words = [row.command, "--robot", str(robot), str(folder), *row.options]
    words += ["--out", str(out)] if row.command == "diagnose" else []
    shown = shlex.join(["residual-mpc", *words])
    click.echo(f"{row.name}: {shown}", err=True)
    kept, code = out / "measured.json", commit()
    if kept.is_file() and not again:
        was = json.loads(kept.read_text(encoding="utf-8"))
        if (was["shown"], was["code"]) == (shown, code):
            return Measured(row, was["document"], was["seconds"], shown)
    begin = perf_counter()
    done = subprocess.run(
        [sys.executable, "-m", "residual_mpc.cli.main", *words, "--json"], stdout=subprocess.PIPE, check=False
    )
    seconds = perf_counter() - begin
    if done.returncode:
        return Measured(row, None, seconds, shown, f"exit status {done.returncode}")
    printed = json.loads(done.stdout)
    out.mkdir(parents=True, exist_ok=True)
    kept.write_text(
        json.dumps({"shown": shown, "code": code, "seconds": seconds, "document": printed}), encoding="utf-8"
    )
    return Measured(row, printed, seconds, shown)


def changed(folder: Path, mass: float, place: Path) -> Path:
    """A copy of the robot file and its models in `place` with another mass (kg)."""
    place.mkdir(parents=True, exist_ok=True)
    for model in folder.glob("*.xml"):
        text, count = re.subn(r'mass="[^"]*"', f'mass="{mass:g}"', model.read_text())
        if count != 1:
            raise ValueError(f"{model} holds {count} masses, one was wanted")
        (place / model.name).write_text(text)
    return Path(shutil.copy(folder / "robot.toml", place))


def document(rows: list[Measured]) -> str:
    """The page."""
    today = datetime.now(UTC).date().isoformat()
    parts = [
        "# Recorded robots\n",
        *in_short([m.document["shrink"] for m in rows if m.document is not None and m.document.get("shrink")]),
        f"Measured on {today} with residual-mpc {version('residual-mpc')}{commit()} by\n"
        "`python -m benchmarks.recorded --page docs/results/recorded.md`. The recordings are not part of this "
        "repository.\n",
        "What each diagnosis was not told, what it expected and what was achieved: [real data,\n"
        "withheld](withheld.md).\n",
        "Gaps and shrinks are measured on runs, or stretches of runs, that no fit has seen. The expected shrink was\n"
        "stated before they were evaluated. A gap of 0.10 means that within one second the model misses a tenth of\n"
        "the motion. Brackets contain 95 % intervals.\n",
        "| robot | gap before | after | noise floor | shrink expected | achieved | verdict | named |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
        *(table_line(m) for m in rows),
        "",
        *each_once([m for m in rows if m.row.name.startswith("so101, fourth")]),
        *(details(m) for m in rows),
        "## Sources\n",
        SOURCES,
    ]
    return "\n".join(parts)


def in_short(shrinks: list[dict[str, Any]]) -> list[str]:
    """The page in two sentences; nothing where no shrink was measured."""
    if not shrinks:
        return []
    values = [s["value"] for s in shrinks]
    held = sum(inside(s["value"], s["expected_ci95"]) for s in shrinks)
    return [
        f"On recorded robots the named effects remove {min(values):.0%} to {max(values):.0%} of the gap on runs that\n"
        f"no fit has seen. In {held} of {len(shrinks)} diagnoses the achieved shrink lies inside the interval that\n"
        "was expected.\n"
    ]


def each_once(fourths: list[Measured]) -> list[str]:
    """What was expected and came in the mean of the four, where all four were measured."""
    shrinks = [m.document["shrink"] for m in fourths if m.document is not None and m.document["shrink"]]
    if len(shrinks) < 4:
        return []
    expected, achieved = ([s[name] for s in shrinks] for name in ("expected", "value"))
    return [
        "In the four fourths each motion of the SO-101 is held out once. Their mean expected shrink is\n"
        f"{fmean(expected):.1%} and their mean achieved shrink {fmean(achieved):.1%}; in a single one the two differ "
        f"by up to {max(abs(e - a) for e, a in zip(expected, achieved, strict=True)):.0%}.\n"
    ]


def commit() -> str:
    """The last commit of the code that diagnoses, and whether it was changed since; empty outside a checkout."""
    code = ("--", "residual_mpc", "plants")
    last, changes = (_git("log", "-1", "--format=%h", *code), _git("status", "--porcelain", *code))
    return f" (commit {last}{', changed since' if changes else ''})" if last else ""


def _git(*words: str) -> str:
    root = Path(__file__).resolve().parents[1]
    try:
        return subprocess.run(["git", *words], cwd=root, capture_output=True, text=True, check=False).stdout.strip()
    except OSError:  # no git here
        return ""


def table_line(m: Measured) -> str:
    """One row of the table."""
    d = m.document
    if d is None:
        return f"| {m.row.name} | not measured: {m.trouble} | | | | | | |"
    if m.row.command == "gap":
        return f"| {m.row.name} | {d['nominal']:.3f} | | {d['noise_floor']:.2g} | | | not diagnosed here | |"
    gap, shrink = d["gap"], d["shrink"]
    low, high = shrink["expected_ci95"] if shrink else (0, 0)
    expected = f"{shrink['expected']:.0%} ({low:.0%} to {high:.0%})" if shrink else ""
    low, high = shrink["ci95"] if shrink else (0, 0)
    achieved = f"{shrink['value']:.0%} ({low:.0%} to {high:.0%})" if shrink else ""
    named = ", ".join(named_of(c) for c in d["explanation"])
    figures = f"{gap['before']:.3f} | {gap['after']:.3f} | {gap['noise_floor']:.2g}"
    return f"| {m.row.name} | {figures} | {expected} | {achieved} | `{d['verdict']}` | {named} |"


def details(m: Measured) -> str:
    """What the table has no room for."""
    lines = [f"## {m.row.name}\n", f"{m.row.what[:1].upper()}{m.row.what[1:]}. {m.row.known}\n"]
    if m.shown:
        lines.append(f"```\n{m.shown}\n```\n")
    d = m.document
    if d is None:
        lines.append(f"Not measured: {m.trouble}.\n")
    elif m.row.command == "gap":
        worst = sorted(d["channels"].items(), key=lambda item: -item[1]["nominal"])
        channels = ", ".join(f"`{name}` {c['nominal']:.2f}" for name, c in worst)
        lines.append(f"{d['windows']} windows of {d['horizon']:g} s. By channel: {channels}.\n")
    else:
        lines.append(f"{d['verdict_sentence']}\n")
        lines += [f"- {cause_line(c)}{beside(c, m.row)}" for c in d["explanation"]]
        if len(d["explanation"]) > 1:
            lines.append(f"- gap as effects are added, over all windows: {chain_line(d['stages_of_gap'])}")
            if m.row.name == PICTURED:
                lines.append(f"\n![The gap of the SO-101 after each effect is added](images/{PICTURED}-staged.png)\n")
        lines += [f"- cannot be told apart on these runs: {group_line(g)}" for g in d["confounded"]]
        if d["shrink"] and not inside(d["shrink"]["value"], d["shrink"]["expected_ci95"]):
            lines.append("- the achieved shrink lies outside the expected interval")
        rest = d["unexplained"]
        share, learned = rest["share"], rest["learned_residual_shrink"]
        lines.append(
            f"- unexplained: {share:.0%} of the squared gap beyond the floor; "
            f"a learned residual removes {learned:.0%} of the remaining gap"
        )
        lines.append(f"- {d['gap']['windows']} windows held out: {held_out(d['held_out'])}")
        lines.append(f"- {m.seconds:.0f} s\n")
    return "\n".join(lines)


def named_of(cause: dict[str, Any]) -> str:
    """`effect` on its target."""
    return f"`{cause['effect']}`" + (f" on {cause['target']}" if cause["target"] else "")


def cause_line(cause: dict[str, Any]) -> str:
    """A cause with its parameters and their intervals."""
    numbers = []
    for name, p in cause["parameters"].items():
        low, high = p["ci95"]
        unit = "" if p["unit"] == "1" else f" {p['unit']}"
        numbers.append(f"{name} {p['value']:.4g}{unit} ({low:.4g} to {high:.4g})")
    return f"{named_of(cause)}: {', '.join(numbers)}; probability {cause['probability']:.2f}"


def chain_line(stages: list[dict[str, Any]]) -> str:
    """The gap after each effect is added."""
    said = [f"{named_of(new)} {after['gap']:.3f}" for new, after in zip(steps_of(stages), stages[1:], strict=True)]
    said = [f"{stages[0]['gap']:.3f}", *said]
    return ", ".join(said)


def beside(cause: dict[str, Any], row: Row) -> str:
    """What is known of a cause's parameters from elsewhere, and whether the interval holds it."""
    said = []
    for name, p in cause["parameters"].items():
        true = row.true.get((cause["effect"], name))
        if true is not None:
            held = "inside" if inside(true, p["ci95"]) else "outside"
            said.append(f"; **known from elsewhere: {true:g}, {held} the interval**")
    return "".join(said)


def inside(value: float, interval: list[float]) -> bool:
    """Whether an interval holds a value."""
    return interval[0] <= value <= interval[1]


def group_line(group: list[Any]) -> str:
    """The members of a confounded group."""
    members = [member if isinstance(member, list) else [member] for member in group]
    return ", ".join(" with ".join(named_of(part) for part in member) for member in members)


def held_out(kept: list[Any]) -> str:
    """Names of runs, or how many stretches."""
    names = [k for k in kept if isinstance(k, str)]
    if not names:
        return f"{len(kept)} stretches of the runs"
    return ", ".join(names) if len(names) <= 8 else f"{len(names)} runs, such as {', '.join(names[:3])}"


if __name__ == "__main__":
    recorded()
