"""Numbers as a person reads them: as many digits as their uncertainty allows."""

from math import floor, isfinite, log10
from typing import NamedTuple

MINUS, NARROW_SPACE = "\u2212", "\u202f"
NONE = "\u2013"
"""Stands where there is no number."""
NOT_DETERMINED = "not determined"
AT_BOUND_SIGMAS = 0.01
"""Standard deviations from its bound, below which a value is the bound: what a solver rounds."""
CERTAIN_SIGMAS = 2.0
"""Standard deviations from its bound, below which a value only says how large it is at most."""

HUMAN_UNITS = {"Pa": ("bar", 1e-5), "1/Pa": ("1/GPa", 1e9), "m3/(s Pa)": ("mL/(min bar)", 6e12)}
"""Units that people read hydraulics in, and how many of them an SI unit is."""

_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_UNIT_POWERS = str.maketrans("23", "²³")
_LONGEST = 6  # digits before or behind the point; numbers beyond are written with a power of ten
_SMALLEST, _FINEST = -3, 9  # a number from 10^-3 on has more digits, so that a table reads as one


def with_uncertainty(value: float, std_dev: float) -> tuple[str, str]:
    """Value and standard deviation, the latter with two digits and both to the same decimal.

    (1523.4, 12.3) -> ("1523", "12"); (-0.0123, 0.00456) -> ("−0.0123", "0.0046"). A value without
    a usable standard deviation has four significant digits, no value is a dash.
    """
    if not isfinite(value):
        return NONE, NONE
    if not (isfinite(std_dev) and std_dev > 0):
        return plain(value, 4), NONE
    decimals = 1 - floor(log10(float(f"{std_dev:.1e}")))
    size = floor(log10(max(abs(value), std_dev)))
    if size > _LONGEST or decimals > (_LONGEST if size < _SMALLEST else _FINEST):
        scale = 10.0**-size
        power = f"·10{str(size).translate(_SUPERSCRIPTS)}"
        return (
            _fixed(value * scale, decimals + size) + power,
            _fixed(std_dev * scale, decimals + size) + power,
        )
    return _fixed(value, decimals), _fixed(std_dev, decimals)


class Shown(NamedTuple):
    """An estimate as it is printed: value, standard deviation, and the latter over the former."""

    value: str
    std_dev: str
    relative: str


def shown(value: float, std_dev: float, minimum: float | None = None) -> Shown:
    """An estimate whose parameter physics keeps above `minimum`, where it does.

    What recordings do not determine is said instead of a number. Without a bound, a parameter may
    well be zero: its standard deviation is no share of it then.
    """
    if not isfinite(value):
        return Shown(NOT_DETERMINED, NONE, NONE)
    printed, deviation = with_uncertainty(value, std_dev)
    if minimum is not None and isfinite(std_dev):
        away = abs(value - minimum)  # below it the value is not physical, which others say
        if away <= AT_BOUND_SIGMAS * std_dev:
            return Shown(f"at its bound {plain(minimum)}", deviation, NONE)
        if away < CERTAIN_SIGMAS * std_dev:
            most = with_uncertainty(value + CERTAIN_SIGMAS * std_dev, std_dev)[0]
            return Shown(f"{NOT_DETERMINED}, at most {most}", deviation, NONE)
    if not value:
        return Shown(printed, deviation, NONE)
    relative = std_dev / abs(value)
    return Shown(
        printed, deviation, percent(relative) if relative <= 1.0 else f"> 100{NARROW_SPACE}%"
    )


def is_determined(value: float, std_dev: float, minimum: float | None = None) -> bool:
    """Return whether `shown` prints a number, or the bound that a value rests at."""
    return not shown(value, std_dev, minimum).value.startswith(NOT_DETERMINED)


def plain(value: float, digits: int = 3) -> str:
    """A number with so many significant digits and no exponent up to a million."""
    if not isfinite(value):
        return "∞" if value > 0 else NONE
    if value == 0:
        return "0"
    size = floor(log10(abs(float(f"{value:.{digits - 1}e}"))))
    if abs(size) > _LONGEST:
        mantissa = _fixed(value * 10.0**-size, digits - 1)
        return f"{mantissa}·10{str(size).translate(_SUPERSCRIPTS)}"
    return _fixed(value, digits - 1 - size)


def percent(share: float) -> str:
    """A share of one in percent: two decimals, a small one its first digit; above 100 % none."""
    if not isfinite(share):
        return NONE
    decimals = 2 if abs(share) < 1 else 0
    if 0 < abs(share) < 1e-4 and float(f"{share:.0e}"):
        decimals = min(-floor(log10(float(f"{abs(share):.0e}"))) - 2, _LONGEST)
    return _fixed(100 * share, decimals) + NARROW_SPACE + "%"


def short_percent(share: float) -> str:
    """A share in percent for running text: two significant digits."""
    if not isfinite(share):
        return "an unknown share"
    return (plain(100 * share, 2) if abs(share) < 0.995 else _fixed(100 * share, 0)) + (
        NARROW_SPACE + "%"
    )


def unit(text: str) -> str:
    """A unit as it is set: powers raised, products with a point: "kg m2" -> "kg m²"."""
    return text.translate(_UNIT_POWERS).replace(" ", NARROW_SPACE)


def human(text: str) -> tuple[str, float]:
    """The unit that a person reads instead of that in SI, as it is set, and its factor."""
    read, factor = HUMAN_UNITS.get(text, (text, 1.0))
    return "" if read == "1" else unit(read), factor


def listed(words: list[str] | tuple[str, ...], last: str = "and") -> str:
    """Words in a sentence: "a, b and c"."""
    return f" {last} ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)


def spoken(joint: str) -> str:
    """Name of a joint in running text: "inner_boom" -> "inner boom"."""
    return joint.replace("_", " ")


def _fixed(value: float, decimals: int) -> str:
    """Fixed point; negative `decimals` round in front of the point; a true minus sign."""
    rounded = round(value, decimals)
    text = f"{abs(rounded):.{max(decimals, 0)}f}"
    return MINUS + text if rounded < 0 else text
