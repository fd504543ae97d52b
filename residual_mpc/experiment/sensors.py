"""Which sensor would show the cause of a gap that no effect explains, by what the gap was found to depend on."""

from collections.abc import Collection, Mapping, Sequence
from typing import Any


def sensors_for(
    remainder: Mapping[str, Any] | None, actuators: Sequence[str], logged: Collection[str]
) -> tuple[str, ...]:
    """Columns that are not logged yet; none where the first dependence asks for no sensor.

    remainder: as diagnosis.json has it. A column of any name is looked at where something is left.
    """
    depends = [] if remainder is None else remainder["depends_on"]
    if not depends:
        return ()
    first = depends[0]
    if first["kind"] == "wheel_angle":
        wanted: tuple[str, ...] = (f"velocity.{first['of']}",)  # an eccentric wheel is told from a bent floor by it
    elif first["kind"] in ("heading", "place"):
        wanted = ("imu.roll", "imu.pitch")
    elif first["kind"] == "work" or (first["kind"] == "time" and first["form"] != "added"):
        # what warms up, or runs down; what comes at one time of each run is something else
        wanted = (*(f"temperature.{a}" for a in actuators), "supply_voltage")
    else:
        wanted = ()
    return tuple(c for c in wanted if c not in logged)
