"""Units as people write them: quotients of quotients taken together."""

import re

TOKEN = re.compile(r"\s*(?:([^\s/*()^]+|\))(?:\^(-?\d+))?(?!\^)|([/*(]))\s*")


def tidy_unit(unit: str) -> str:
    """Return a product of powers for a quotient of units; a dash where everything cancels.

    What cannot be read as products, quotients and whole powers is returned as it came.

    Examples
    --------
    >>> from narx_sklearn.discrepancy.units import tidy_unit
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
