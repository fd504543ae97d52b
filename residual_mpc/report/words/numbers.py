"""Numbers as people write them: few digits, a unit that suits the size, precision set by the interval."""

import math
import re
from collections.abc import Sequence

SPACE = "\N{NO-BREAK SPACE}"
MINUS = "\N{MINUS SIGN}"
ARROW = "\N{RIGHTWARDS ARROW}"
DEGREE = "\N{DEGREE SIGN}"
SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")

# unit -> (the size below which the smaller unit reads better, factor, smaller unit)
SMALLER = {
    "s": (1.0, 1e3, "ms"),
    "m": (0.1, 1e3, "mm"),
    "kg": (0.1, 1e3, "g"),
    "m/s": (0.1, 1e3, "mm/s"),
    "N m": (0.1, 1e3, "mN m"),
}
Interval = Sequence[float | None]


def number(value: float | None, digits: int = 3) -> str:
    """`value` to at most `digits` significant digits: 0.0812, 1240, 2.5 x 10^-6; a dash for none."""
    if value is None or not math.isfinite(value):
        return "\N{EN DASH}"
    if value == 0:
        return "0"
    exponent = math.floor(math.log10(abs(value)))
    if -4 <= exponent < 6:
        return _trimmed(_fixed(value, max(0, digits - 1 - exponent)))
    mantissa = _trimmed(_fixed(value / 10.0**exponent, digits - 1))
    return f"{mantissa}{SPACE}×{SPACE}10{str(exponent).translate(SUPERSCRIPTS)}"


def percent(share: float | None) -> str:
    """0.857 as 86 %; a tenth of a per cent below ten; what rounds to nothing as less than 0.1 %."""
    if share is None or not math.isfinite(share):
        return "\N{EN DASH}"
    hundredths = 100.0 * share
    if 0 < abs(hundredths) < 0.1:
        return f"<{SPACE}0.1{SPACE}%" if share > 0 else f"0{SPACE}%"
    decimals = 0 if abs(hundredths) >= 9.95 or hundredths == 0 else 1
    return f"{_trimmed(_fixed(hundredths, decimals))}{SPACE}%"


def percent_of_nominal(factor: float) -> str:
    """1.0251 as 102.5 %: a tenth of a per cent within a tenth of 1, where it matters."""
    if abs(factor - 1.0) >= 0.1 or not math.isfinite(factor):
        return percent(factor)
    return f"{_trimmed(_fixed(100.0 * factor, 1))}{SPACE}%"


def percent_interval(interval: Interval | None) -> str:
    """[0.83, 0.89] as "83 % to 89 %"; empty where there is no interval."""
    if not interval:
        return ""
    low, high = interval
    return f"{percent(low)} to {percent(high)}"


def measure(value: float | None, unit: str, digits: int = 3) -> str:
    """A value with its unit: 0.081 s as 81 ms; radians carry their degrees; the unit 1 is left out."""
    if value is None or not math.isfinite(value):
        return "\N{EN DASH}"
    factor, shown = _scale(value, unit)
    degrees = f" ({number(math.degrees(value), 2)}{DEGREE})" if unit == "rad" else ""
    return f"{number(value * factor, digits)}{_suffix(shown)}{degrees}"


def measure_each(values: Sequence[float], unit: str) -> list[str]:
    """Values with their unit, with more digits where two of them would look alike."""
    for digits in (3, 4, 5):
        shown = [measure(v, unit, digits) for v in values]
        if len(set(shown)) == len(set(values)):
            break
    return shown


def measure_interval(value: float | None, interval: Interval | None, unit: str) -> str:
    """A value with its 95 % interval, to the digits that the interval leaves: "81 ms (78 to 84)"."""
    low, high = interval or (None, None)
    if value is None or low is None or high is None or not math.isfinite(high - low):
        return measure(value, unit)
    factor, shown = _scale(value, unit)
    # to the side that is nearer, as long as it is no tiny part of the interval
    side = max(min(high - value, value - low), 0.1 * (high - low))
    decimals = _decimals(factor * min(side, 0.5 * (high - low)), factor * value)
    degrees = f", {number(math.degrees(value), 2)}{DEGREE}" if unit == "rad" else ""
    middle, low_text, high_text = (_fixed(factor * x, decimals) for x in (value, low, high))
    return f"{middle}{_suffix(shown)} ({low_text} to {high_text}){degrees}"


def interval_in(interval: Interval, unit: str) -> str:
    """A 95 % interval in the unit that suits its middle: "78 to 84 ms"; empty where an end is not known."""
    low, high = interval
    if low is None or high is None or not math.isfinite(high - low):
        return ""
    factor, shown = _scale(0.5 * (low + high), unit)
    decimals = _decimals(factor * 0.5 * (high - low), factor * 0.5 * (low + high))
    return f"{_fixed(factor * low, decimals)} to {_fixed(factor * high, decimals)}{_suffix(shown)}"


def count(number_of: int, noun: str) -> str:
    """ "1 window", "3 windows"."""
    return f"{number_of} {noun}{'' if number_of == 1 else 's'}"


def listed(words: Sequence[str], joint: str = "and") -> str:
    """["a", "b", "c"] as "a, b and c"."""
    *most, last = words
    return f"{', '.join(most)} {joint} {last}" if most else last


def _scale(value: float, unit: str) -> tuple[float, str]:
    below, factor, smaller = SMALLER.get(unit, (0.0, 1.0, unit))
    return (factor, smaller) if 0.0 < abs(value) < below else (1.0, unit)


def _decimals(half_width: float, value: float) -> int:
    """One digit of the half width, two where it starts with 1 or 2; three of the value where it is 0."""
    size = half_width or 0.03 * abs(value) or 1.0
    exponent = math.floor(math.log10(size))
    leading = size / 10.0**exponent
    return min(8, max(0, -exponent + (1 if leading < 3 and exponent < 0 else 0)))


def _fixed(value: float, decimals: int) -> str:
    text = f"{value:.{decimals}f}"
    if float(text) == 0:
        text = text.lstrip("-")
    return text.replace("-", MINUS)


def _trimmed(text: str) -> str:
    return text.rstrip("0").rstrip(".") if "." in text else text


def spelled(unit: str) -> str:
    """A unit as it is printed: nothing for 1, "rad/s²" for rad/s^2, "per turn" for 1/turn, "per N m" for 1/(N m)."""
    if unit in ("", "1"):
        return ""
    unit = f"per {unit[2:].strip('()')}" if unit.startswith("1/") else unit
    return re.sub(r"\^(-?\d+)", lambda power: power[1].translate(SUPERSCRIPTS), unit).replace(" ", SPACE)


def in_brackets(unit: str) -> str:
    """ " (rad)", for a label; empty for the unit 1."""
    return f" ({spelled(unit)})" if spelled(unit) else ""


def plain(text: str) -> str:
    """`text` for a terminal: the spaces and signs that a keyboard has, so that a search finds them."""
    return text.replace(SPACE, " ").replace(MINUS, "-").replace(ARROW, "->")


def _suffix(unit: str) -> str:
    return SPACE + spelled(unit) if spelled(unit) else ""
