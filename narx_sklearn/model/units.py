"""Units as people write them: quotients of quotients taken together, and what one is worth in another."""

import math
import re
from typing import NamedTuple

RATE = "rate"  # with which the name of a rate may begin
TOKEN = re.compile(r"\s*(?:([^\s/*()^]+|\))(?:\^(-?\d+))?(?!\^)|([/*(]))\s*")


def rate_of(name: str) -> str:
    """Return what the rate of a signal is called, where the signal may be a rate itself.

    Examples
    --------
    >>> from narx_sklearn.model.units import rate_of
    >>> rate_of("level"), rate_of("rate of turn")
    ('rate of level', 'change of rate of turn')
    """
    return f"change of {name}" if name.lower().startswith(f"{RATE} ") else f"rate of {name}"


def tidy_unit(unit: str) -> str:
    """Return a product of powers for a quotient of units; a dash where everything cancels.

    What cannot be read as products, quotients and whole powers is returned as it came.

    Examples
    --------
    >>> from narx_sklearn.model.units import tidy_unit
    >>> [tidy_unit(unit) for unit in ("m/s/s", "m/(m)", "N s/m/(m/s)", "1/(m/s^2)^2", "N/(m)^n")]
    ['m/s^2', '-', 'N s^2/m^2', 's^4/m^2', 'N/(m)^n']
    """
    groups: list[dict[str, int]] = [{}]
    signs, end = [1], 0
    while end < len(unit):
        match = TOKEN.match(unit, end)
        if match is None or (match[1] == ")" and len(groups) == 1):
            return unit
        end = match.end()
        name, power, mark = match.groups()
        if mark == "(":
            groups.append({})
            signs.append(1)
        elif mark:
            signs[-1] = -1 if mark == "/" else 1
        else:
            inner = {name: 1}
            if name == ")":
                inner, _ = groups.pop(), signs.pop()
            for factor, count in inner.items():
                groups[-1][factor] = groups[-1].get(factor, 0) + signs[-1] * int(power or 1) * count
    if len(groups) > 1:
        return unit
    powers = {name: count for name, count in groups[0].items() if count and name not in ("1", "-")}
    above = " ".join(_power(name, count) for name, count in powers.items() if count > 0)
    below = "".join("/" + _power(name, -count) for name, count in powers.items() if count < 0)
    return (above or "1") + below if powers else "-"


def _power(name: str, count: int) -> str:
    return name if count == 1 else f"{name}^{count}"


# -- what a unit is worth --------------------------------------------------------------------------------

PREFIXES = {
    "T": 1e12, "G": 1e9, "M": 1e6, "k": 1e3, "h": 1e2, "d": 1e-1, "c": 1e-2, "m": 1e-3,
    "u": 1e-6, "µ": 1e-6, "μ": 1e-6, "n": 1e-9, "p": 1e-12,
}  # fmt: skip
SYMBOLS: dict[str, tuple[float, dict[str, int]]] = {
    "m": (1.0, {"m": 1}),
    "g": (1e-3, {"kg": 1}),
    "s": (1.0, {"s": 1}),
    "A": (1.0, {"A": 1}),
    "K": (1.0, {"K": 1}),
    "mol": (1.0, {"mol": 1}),
    "rad": (1.0, {"rad": 1}),
    "N": (1.0, {"kg": 1, "m": 1, "s": -2}),
    "Nm": (1.0, {"kg": 1, "m": 2, "s": -2}),
    "J": (1.0, {"kg": 1, "m": 2, "s": -2}),
    "W": (1.0, {"kg": 1, "m": 2, "s": -3}),
    "Pa": (1.0, {"kg": 1, "m": -1, "s": -2}),
    "bar": (1e5, {"kg": 1, "m": -1, "s": -2}),
    "V": (1.0, {"kg": 1, "m": 2, "s": -3, "A": -1}),
    "Ohm": (1.0, {"kg": 1, "m": 2, "s": -3, "A": -2}),
    "Ω": (1.0, {"kg": 1, "m": 2, "s": -3, "A": -2}),
    "H": (1.0, {"kg": 1, "m": 2, "s": -2, "A": -2}),
    "F": (1.0, {"kg": -1, "m": -2, "s": 4, "A": 2}),
    "T": (1.0, {"kg": 1, "s": -2, "A": -1}),
    "Hz": (1.0, {"s": -1}),
    "L": (1e-3, {"m": 3}),
    "l": (1e-3, {"m": 3}),
}
WHOLE: dict[str, tuple[float, dict[str, int]]] = {  # units that take no prefix
    "min": (60.0, {"s": 1}),
    "h": (3600.0, {"s": 1}),
    "in": (0.0254, {"m": 1}),
    "inch": (0.0254, {"m": 1}),
    "ft": (0.3048, {"m": 1}),
    "psi": (6894.757, {"kg": 1, "m": -1, "s": -2}),
    "atm": (101325.0, {"kg": 1, "m": -1, "s": -2}),
    "lbf": (4.448222, {"kg": 1, "m": 1, "s": -2}),
    "deg": (math.pi / 180, {"rad": 1}),
    "°": (math.pi / 180, {"rad": 1}),
    "rev": (2 * math.pi, {"rad": 1}),
    "rpm": (2 * math.pi / 60, {"rad": 1, "s": -1}),
    "mph": (0.44704, {"m": 1, "s": -1}),
    "kn": (1852 / 3600, {"m": 1, "s": -1}),
    "%": (0.01, {}),
    "degC": (1.0, {"K": 1}),
    "°C": (1.0, {"K": 1}),
    "degF": (5 / 9, {"K": 1}),
    "°F": (5 / 9, {"K": 1}),
}
ZEROS = {"K": 0.0, "degC": 273.15, "°C": 273.15, "degF": 459.67 * 5 / 9, "°F": 459.67 * 5 / 9}  # in K
SUPERSCRIPTS = str.maketrans({"²": "^2", "³": "^3", "·": " ", "⋅": " ", "\N{OHM SIGN}": "Ω"})
ROUNDING = 1e-9  # relative difference up to which two factors are one


class Conversion(NamedTuple):
    """How values in one unit become values in another: ``factor * value + offset``."""

    factor: float
    offset: float = 0.0

    @property
    def is_none(self) -> bool:
        """Whether nothing changes."""
        return abs(self.factor - 1.0) <= ROUNDING and self.offset == 0.0

    @property
    def in_words(self) -> str:
        """What is to be done to values."""
        done = [] if abs(self.factor - 1.0) <= ROUNDING else [f"times {self.factor:.6g}"]
        done += [f"plus {self.offset:.6g}"] if self.offset > 0 else []
        done += [f"minus {-self.offset:.6g}"] if self.offset < 0 else []
        return f"its values are to be taken {' '.join(done)}"


def conversion(given: str, wanted: str) -> Conversion | None:
    """Return how values in one unit become values in another; None where that is not known.

    Examples
    --------
    >>> from narx_sklearn.model.units import conversion
    >>> conversion("mV", "V").factor, conversion("m/s^2/V", "m/(s^2 V)").is_none, conversion("A", "V")
    (0.001, True, None)
    """
    if tidy_unit(given) == tidy_unit(wanted):
        return Conversion(1.0)
    if given in ZEROS and wanted in ZEROS:
        (a, _), (b, _) = _worth(given), _worth(wanted)
        return Conversion(a / b, round((ZEROS[given] - ZEROS[wanted]) / b, 9))
    (a, dimension), (b, other) = _worth(given), _worth(wanted)
    if dimension == other:
        return Conversion(a / b)
    # an angle counts nothing, in radians or in turns: rad/s and 1/s are one, and rpm and 1/min
    ours, theirs = ({base: n for base, n in d.items() if base != "rad"} for d in (dimension, other))
    turns = (2 * math.pi) ** (dimension.get("rad", 0) - other.get("rad", 0))
    alike = any(math.isclose(a, size * b, rel_tol=ROUNDING) for size in (1.0, turns))
    return Conversion(1.0) if alike and ours == theirs else None


def compare_units(column: str, given: str, whose: str, wanted: str) -> str:
    """Raise where a column's unit is another than a signal's; return what to warn of where none can tell.

    Parameters
    ----------
    column : str
        The column, in words that begin a sentence.
    given, wanted : str
        Its unit, and the signal's; empty where nobody told it.
    whose : str
        The signal, in words.

    Returns
    -------
    str
        Empty where the units are one.

    Raises
    ------
    ValueError
        If the values would have to be converted.

    Examples
    --------
    >>> from narx_sklearn.model.units import compare_units
    >>> compare_units("Column 'gap'", "mm", "the output 'y'", "m/1000")
    "Column 'gap' states another unit than the output 'y', and none that is known to be the same. Check that \
it is the right column, in the right unit."
    """
    change = conversion(given, wanted) if given and wanted else Conversion(1.0)
    if change is None:
        return (
            f"{column} states another unit than {whose}, and none that is known to be the same. Check that "
            "it is the right column, in the right unit."
        )
    if not change.is_none:
        raise ValueError(
            f"{column} is in another unit than {whose}: {change.in_words}. Convert the column and its label, "
            "or drop the unit from the label if it is wrong."
        )
    return ""


def scale_to(given: str, wanted: str) -> float | None:
    """Return how many of one unit another is; None where they do not measure the same.

    Examples
    --------
    >>> from narx_sklearn.model.units import scale_to
    >>> round(scale_to("deg", "rad"), 6), scale_to("cm", "m"), scale_to("-", "rad")
    (0.017453, 0.01, None)
    """
    (a, dimension), (b, other) = _worth(given), _worth(wanted)
    return a / b if dimension == other else None


def may_be_alike(unit: str, other: str) -> bool:
    """Tell whether two units may measure the same; one that nobody told measures anything.

    Examples
    --------
    >>> from narx_sklearn.model.units import may_be_alike
    >>> may_be_alike("cm", "m"), may_be_alike("cm", ""), may_be_alike("cm", "m/s")
    (True, True, False)
    """
    return not (unit and other) or scale_to(unit, other) is not None


def is_per_time(unit: str) -> bool:
    """Tell whether a unit counts something per time.

    Examples
    --------
    >>> from narx_sklearn.model.units import is_per_time
    >>> [is_per_time(unit) for unit in ("m/s", "km/h", "rpm", "turns/s", "m", "m/s^2", "N")]
    [True, True, True, True, False, False, False]
    """
    return _worth(unit)[1].get("s") == -1


def alike_but_for_time(unit: str, other: str) -> bool:
    """Tell whether units measure the same, but for being per time or not.

    Examples
    --------
    >>> from narx_sklearn.model.units import alike_but_for_time
    >>> [alike_but_for_time(unit, "m") for unit in ("mm", "m/s^2", "N m", "rad/s")]
    [True, True, False, False]
    """
    ours, theirs = ({base: n for base, n in _worth(u)[1].items() if base != "s"} for u in (unit, other))
    return ours == theirs


def _worth(unit: str) -> tuple[float, dict[str, int]]:
    """Return a unit in SI units and its dimension; what is not known is a dimension of its own."""
    scale, dimension = 1.0, dict[str, int]()
    for name, power in _powers(tidy_unit(unit.translate(SUPERSCRIPTS))).items():
        size, within = _symbol(name)
        scale *= size**power
        for base, count in within.items():
            dimension[base] = dimension.get(base, 0) + power * count
    return scale, {base: count for base, count in dimension.items() if count}


def _powers(unit: str) -> dict[str, int]:
    """Return the factors of a tidy unit and their powers."""
    powers: dict[str, int] = {}
    sign = 1
    for name, power, mark in TOKEN.findall(unit):
        if mark:
            sign = -1 if mark == "/" else 1
        elif name not in ("1", "-"):
            powers[name] = powers.get(name, 0) + sign * int(power or 1)
            sign = 1
        else:
            sign = 1
    return powers


def _symbol(name: str) -> tuple[float, dict[str, int]]:
    for known in (WHOLE, SYMBOLS):
        if name in known:
            return known[name]
    if name[:1] in PREFIXES and name[1:] in SYMBOLS:
        scale, dimension = SYMBOLS[name[1:]]
        return PREFIXES[name[0]] * scale, dimension
    if name[-1:].isdigit() and name[:-1].isalpha():  # "s2" for "s^2"
        scale, dimension = _symbol(name[:-1])
        power = int(name[-1])
        return scale**power, {base: power * count for base, count in dimension.items()}
    return 1.0, {name: 1}


def in_seconds(time: float, digits: int = 5) -> str:
    """Return a time with its unit, a long one without a power of ten.

    Examples
    --------
    >>> in_seconds(7.5), in_seconds(149760.0)
    ('7.5 s', '149760 s')
    """
    return (f"{time:.0f}" if abs(time) >= 10**digits else f"{time:.{digits}g}") + " s"


def rounded(times: float) -> str:
    """Return a factor to two digits, a large one without a power of ten.

    Examples
    --------
    >>> rounded(1.52), rounded(123.0)
    ('1.5', '120')
    """
    return f"{float(f'{times:.2g}'):.9g}"
