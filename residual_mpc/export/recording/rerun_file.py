"""A run as a Rerun recording (.rrd): signals and gaps over time, the robot in space, and a layout that shows them."""

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from residual_mpc.export.recording.recording import Recording
from residual_mpc.export.recording.scene import SOURCES, Scene
from residual_mpc.export.recording.trace import Array, Trace
from residual_mpc.extras import extra
from residual_mpc.report.motion.ink import CORRECTED, PREDICTED

SUFFIX = ".rrd"
APPLICATION = "residual-mpc"
TIME, STAMP = "time", "stamp"  # timelines: s from the run's start, and the log's own clock
COLOURS = {"measured": (128, 128, 128), "nominal": PREDICTED.colour, "corrected": CORRECTED.colour}
FLOOR = (170, 170, 170)
WIDTHS = {"measured": 3.0, "nominal": 1.5, "corrected": 1.5}  # px
COMMANDS, CHANNELS, GAP, ROBOT = "command", "channels", "gap", "robot"


def rerun_bytes(recording: Recording, trace: Trace, drawn: Scene | None) -> bytes:
    """The whole file; without the robot where `drawn` is None. Raises BadInput where the package is missing."""
    with extra("rerun"):
        import rerun as rr
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / f"run{SUFFIX}"
        stream = rr.RecordingStream(APPLICATION, recording_id=f"{recording.robot}: {trace.run}")
        stream.save(file, default_blueprint=_layout(trace, drawn))
        stream.send_recording_name(trace.run)
        for name, text in recording.notes(trace).items():
            stream.send_property(name, rr.AnyValues(value=text))
        _signals(stream, trace)
        _gaps(stream, recording, trace)
        if drawn is not None:
            _robot(stream, trace, drawn)
        stream.flush()
        stream.disconnect()
        return file.read_bytes()


def _signals(stream: Any, trace: Trace) -> None:
    for channel, y in trace.measured.items():
        _line(stream, trace, (CHANNELS, channel, "measured"), trace.t, y)
    for source, columns in (("nominal", trace.nominal), ("corrected", trace.corrected)):
        for channel in trace.channels:
            if channel in columns:
                _line(stream, trace, (CHANNELS, channel, source), trace.at, columns[channel])
    for column, y in trace.sent.items():
        _line(stream, trace, (COMMANDS, column), trace.t, y, held=True)


def _gaps(stream: Any, recording: Recording, trace: Trace) -> None:
    """Each window's gap from its start to the next one's."""
    w = trace.windows
    _line(stream, trace, (GAP, "nominal"), w.start, w.nominal, held=True)
    _line(stream, trace, (GAP, "corrected"), w.start, w.corrected, held=True)
    floor = np.full(len(w.start), recording.noise_floor)
    _line(stream, trace, (GAP, "noise_floor"), w.start, floor, held=True)


def _line(stream: Any, trace: Trace, path: Sequence[str], t: Array, y: Array, held: bool = False) -> None:
    """A signal y (n,) at t (n,) s without its missing samples; held: each value holds until the next."""
    import rerun as rr

    good = np.isfinite(y)
    if not good.any():
        return
    name, entity = path[-1], rr.new_entity_path(list(path))
    colour = COLOURS.get(name, FLOOR if name == "noise_floor" else None)
    step = rr.components.InterpolationMode.StepAfter if held else None
    style = rr.SeriesLines(names=name, colors=colour, widths=WIDTHS.get(name), interpolation_mode=step)
    stream.log(entity, style, static=True)
    stream.send_columns(entity, _clocks(trace, t[good]), rr.Scalars.columns(scalars=y[good]))


def _clocks(trace: Trace, t: Array) -> list[Any]:
    """Both timelines at t (n,) s from the run's start, in whole nanoseconds."""
    import rerun as rr

    since = np.round(t * 1e9).astype(np.int64)
    stamp = since + round(trace.start * 1e9)
    return [
        rr.TimeColumn(TIME, duration=since.astype("timedelta64[ns]")),
        rr.TimeColumn(STAMP, timestamp=stamp.astype("datetime64[ns]")),
    ]


def _robot(stream: Any, trace: Trace, drawn: Scene) -> None:
    """The robot frame by frame, and the paths of its windows, which are always shown."""
    import rerun as rr

    stream.log(ROBOT, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    for source in SOURCES:
        colour, entity = COLOURS[source], f"{ROBOT}/{source}"
        thick, thin = (rr.Radius.ui_points(k * WIDTHS[source]) for k in (1.0, 0.4))
        paths = drawn.paths(source)
        if paths:
            stream.log(f"{entity}/path", rr.LineStrips3D(paths, colors=colour, radii=thin), static=True)
        body = drawn.bodies[source]
        good = np.isfinite(body).all(axis=(1, 2, 3))
        if not good.any():
            continue
        lines = body[good].reshape(-1, *body.shape[2:])
        columns = rr.LineStrips3D.columns(strips=list(lines)).partition([body.shape[1]] * int(good.sum()))
        stream.log(f"{entity}/body", rr.LineStrips3D.from_fields(colors=colour, radii=thick), static=True)
        stream.send_columns(f"{entity}/body", _clocks(trace, drawn.at[good]), columns)


def _layout(trace: Trace, drawn: Scene | None) -> Any:
    """The robot at the left, where there is one; channels, gap and commands at the right."""
    import rerun as rr
    import rerun.blueprint as rrb

    compared = trace.channels or tuple(trace.measured)
    plots = [rrb.TimeSeriesView(origin=rr.new_entity_path([CHANNELS, c]), name=c) for c in compared]
    signals = rrb.Vertical(
        rrb.Grid(*plots, name="channels"),
        rrb.TimeSeriesView(origin=GAP, name="gap of each window"),
        rrb.TimeSeriesView(origin=COMMANDS, name="commands"),
        row_shares=[4, 1, 1],
    )
    shown = signals if drawn is None else rrb.Horizontal(rrb.Spatial3DView(origin=ROBOT, name="robot"), signals)
    panel = rrb.TimePanel(timeline=TIME, state="collapsed")
    return rrb.Blueprint(shown, panel, rrb.SelectionPanel(state="collapsed"))
