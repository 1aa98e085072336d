"""Mistakes of a record in words, with the units that a factor or a shift looks like."""

from collections.abc import Sequence

import numpy as np

from narx_sklearn.discrepancy.records.finding import DataFinding
from narx_sklearn.discrepancy.records.mistakes import (
    DECISIVE,
    OFFSET_LIMIT,
    SCALE_RANGE,
    Agreement,
    Case,
    Mistake,
    agreement_at_best,
)
from narx_sklearn.discrepancy.simulators.simulator import Simulator
from narx_sklearn.model.units import alike_but_for_time

# what a factor may be, and the units of one kind that it lies between
KNOWN_RATIOS = (
    (1e3, "between a unit and its thousandth (m and mm)", ""),
    (1e6, "between a unit and its millionth (m and um)", ""),
    (1e9, "between a unit and its billionth (m and nm)", ""),
    (100.0, "between a unit and its hundredth, or a fraction and per cent", ""),
    (10.0, "between a unit and its tenth", ""),
    (1 / 0.0254, "between metres and inches (39.37)", "m"),
    (25.4, "between inches and millimetres (25.4)", "m"),
    (1 / 0.3048, "between metres and feet (3.281)", "m"),
    (180 / np.pi, "between radians and degrees", "rad"),
    (30 / np.pi, "between rad/s and rpm (9.549)", "rad/s"),
    (2 * np.pi, "between turns and radians (6.283)", "rad"),
    (1e5, "between bar and Pa", "Pa"),
    (6894.757, "between psi and Pa (6895)", "Pa"),
    (14.50377, "between bar and psi (14.5)", "Pa"),
)
NEAR_RATIO = 1.33  # a gain is known to a third only
NAMED = 2  # of the changes of units that a factor looks like
FAHRENHEIT = 1.8  # degrees to one of Celsius
ZEROS = (  # slope, offset, what lies between
    (1.0, 273.15, "between degrees Celsius and kelvin (273.15)"),
    (FAHRENHEIT, 32.0, "between degrees Celsius and Fahrenheit (1.8, 32)"),
    (FAHRENHEIT, -459.67, "between kelvin and degrees Fahrenheit (1.8, -459.67)"),
)
TEMPERATURES = ("", "K", "degC", "°C", "degF", "°F", "C", "F")
NEAR_ZERO = 0.1  # of an offset, by which it may be off


def mistake_in_words(simulator: Simulator, mistake: Mistake) -> DataFinding:
    """Return a mistake as a finding."""
    about = mistake.about
    i, j = about.get("input"), about.get("output")
    inputs = about.get("inputs", () if i is None else (i,))
    outputs = about.get("outputs", () if j is None else (j,))
    named = " and ".join(
        [f"input {simulator.inputs[index]}" for index in inputs]
        + [f"output {simulator.outputs[index]}" for index in outputs]
    )
    if mistake.code == "time_scale":
        dt = about["factor"] * simulator.dt
        what = (
            f"The record runs {about['factor']:g} times as fast as the simulator: as if dt were "
            f"{dt:.6g} s and not {simulator.dt:.6g} s. Check the sampling period"
        )
    elif mistake.code == "swapped":
        what = f"{named} seem to be swapped"
    elif mistake.code == "wrapped":
        turn = f"{about['turn']:.6g}"
        what = (
            f"{named} begins anew after a turn of {turn}. Let it go on: "
            f"numpy.unwrap(column, period={turn}), session by session"
        )
    elif mistake.code == "unsigned":
        what = (
            f"{named} has no sign: it shows how large what is simulated is, not which way it goes. Let the "
            "simulation's output be that size (abs in the simulator's output function)"
        )
    elif mistake.code == "sign":
        what = f"The sign of {named} seems to be reversed"
    else:
        samples = about["samples"]
        late = (samples > 0) == (j is not None)
        time = f"{abs(samples)} samples ({abs(samples) * simulator.dt:.4g} s)"
        what = f"{named} comes {time} too {'late' if late else 'early'}: a shifted column"
        if samples > 0:
            what += ", or a dead time that the simulation lacks"
    sentence = (
        f"{what[0].upper()}{what[1:]}. Undone, the share of the output's variance that the refitted "
        f"simulator misses falls from {mistake.before:.3g} to {mistake.after:.3g}."
    )
    numbers = {"before": mistake.before, "after": mistake.after, "windows_agreeing": mistake.agreeing}
    return DataFinding(mistake.code, sentence, about | numbers)


def other_units(simulator: Simulator, case: Case, scaled: Agreement) -> list[DataFinding]:
    """Return findings where only another scale or a large offset makes the output agree."""
    plain = agreement_at_best(case, scaled=False)
    if plain is None or not scaled.error < min(DECISIVE * plain.error, 0.5):
        return []
    found = []
    for j, signal in enumerate(simulator.outputs):
        units = [signal.unit, *(s.unit for s in simulator.inputs)]
        slope, offset = float(scaled.affine.slope[j]), float(scaled.affine.offset[j])
        spread = float(np.nanstd(case.y[:, j]))
        facts, alike = [], alike_ratios(slope, units)
        if not SCALE_RANGE[0] < slope < SCALE_RANGE[1]:
            facts.append(f"{slope:.4g} times what the simulator gives{_in_words(alike)}")
        if abs(offset) > OFFSET_LIMIT * spread:
            facts.append(
                f"shifted by {offset:.6g}, {abs(offset) / spread:.1f} standard deviations"
                + named_zero(slope, offset, signal.unit)
            )
        if facts:
            found.append(
                DataFinding(
                    "units",
                    f"Output {signal} is {' and '.join(facts)}: another unit of the output or of an "
                    f"input, or another zero. So scaled, what is missed falls from {plain.error:.3g} to "
                    f"{scaled.error:.3g} of the variance. Convert the column.",
                    {
                        "output": j,
                        "slope": slope,
                        "offset": offset,
                        "alike": alike,
                        "before": plain.error,
                        "after": scaled.error,
                    },
                )
            )
    return found


def alike_ratios(slope: float, units: Sequence[str]) -> list[str]:
    """Return the changes of units that a slope looks like, those first that the signals' units must have.

    Those of another kind than all units that are stated are left out.
    """
    size = max(slope, 1 / slope)
    unstated = not all(units)
    alike = []
    for ratio, words, unit in KNOWN_RATIOS:
        away = abs(np.log(size / ratio))
        of_its_kind = bool(unit) and any(alike_but_for_time(unit, other) for other in units if other)
        if away < np.log(NEAR_RATIO) and (of_its_kind or unstated or not unit):
            alike.append((not of_its_kind, away, words))
    return [words for *_, words in sorted(alike)]


def _in_words(alike: Sequence[str]) -> str:
    return f", as {', or '.join(alike[:NAMED])}" if alike else ""


def named_zero(slope: float, offset: float, unit: str) -> str:
    """Return the scales of temperature that a shifted output looks like."""
    if unit not in TEMPERATURES or slope <= 0:
        return ""
    for scale, zero, words in ZEROS:
        for a, b in ((scale, zero), (1 / scale, -zero / scale)):
            if abs(np.log(slope / a)) < np.log(NEAR_RATIO) and abs(offset - b) < NEAR_ZERO * abs(b):
                return f", as {words}"
    return ""
