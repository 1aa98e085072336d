"""``narx-sklearn excite``."""

import numpy as np

from narx_sklearn.cli._errors import UsageError
from narx_sklearn.cli._files import check_writable
from narx_sklearn.cli._output import write_columns
from narx_sklearn.signals import StepTable, multisine, prfs, prvs

OWN = {"prvs": ("hold",), "prfs": ("frequency",), "multisine": ("band", "odd")}


def run(options) -> None:
    """Make the signal and write it."""
    check_writable(options.output)
    if not options.min < options.max:
        raise UsageError(f"--min {options.min:g} must lie below --max {options.max:g}.")
    if options.samples < 2:
        raise UsageError(f"--samples must be at least 2, got {options.samples}.")
    others = {option for kind, names in OWN.items() if kind != options.signal for option in names}
    given = sorted(option for option in others if getattr(options, option))
    if given:
        raise UsageError(f"--{given[0]} does not belong to {options.signal}.")
    u = {"prvs": _prvs, "prfs": _prfs, "multisine": _multisine}[options.signal](options)
    write_columns(options.output, {"time [s]": options.dt * np.arange(u.size), options.name: u})


def _prvs(options) -> np.ndarray:
    if options.hold is None:
        raise UsageError("prvs needs --hold: the least and most samples that a level is held.")
    if not 1 <= options.hold[0] <= options.hold[1]:
        least, most = options.hold
        raise UsageError(f"--hold {least} {most}: the least must be at least 1, the most no less than it.")
    least, most = ((value,) for value in options.hold)
    steps = StepTable((options.max - options.min,), least, most, least, most)
    return prvs(options.samples, steps, u_min=options.min, u_max=options.max, random_state=options.seed)


def _prfs(options) -> np.ndarray:
    if options.frequency is None:
        raise UsageError("prfs needs --frequency: the cutoff of the noise in Hz.")
    middle, half = (options.max + options.min) / 2, (options.max - options.min) / 2
    u = prfs(
        options.samples,
        options.frequency,
        options.dt,
        operating_points=middle,
        amplitudes=half,
        final_cutoff=np.inf,
        random_state=options.seed,
    )
    return np.clip(u, options.min, options.max)


def _multisine(options) -> np.ndarray:
    band = None if options.band is None else tuple(options.band)
    lines = "odd" if options.odd else "full"
    u = multisine(options.samples, options.dt, band=band, lines=lines, random_state=options.seed)
    low, high = u.min(), u.max()
    return options.min + (u - low) * ((options.max - options.min) / (high - low))
