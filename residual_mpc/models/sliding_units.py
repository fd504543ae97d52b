"""Units of a joint that slides, where one that turns has angles and torques."""

_SLIDING = {
    "N m/rad": "N/m", "N m s/rad": "N s/m", "N m": "N", "rad/s": "m/s", "rad/s^2": "m/s^2", "rad": "m", "kg m^2": "kg",
    "N m/s": "N/s", "1/(N m)": "1/N",
}  # fmt: skip


def sliding_unit(unit: str) -> str:
    """The unit on a joint that slides of what has `unit` on one that turns."""
    return _SLIDING.get(unit, unit)
