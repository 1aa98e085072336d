"""Mistakes in a record that would be sold as physics: found before the diagnosis begins."""

import numpy as np

from narx_sklearn._validation import (
    check_same_length,
    finite_rows,
    finite_slices,
    session_slices,
)
from narx_sklearn.discrepancy.columns import read_columns
from narx_sklearn.discrepancy.records.counts import counted, fewest
from narx_sklearn.discrepancy.records.finding import DataFinding
from narx_sklearn.discrepancy.records.in_words import mistake_in_words, other_units
from narx_sklearn.discrepancy.records.mistakes import find_mistakes, make_case
from narx_sklearn.discrepancy.simulators.simulator import Simulator


def check_record(simulator: Simulator, u, y, sessions=None, n_jobs=None) -> tuple[DataFinding, ...]:
    """Look for mistakes in a record before physics is looked for.

    Counts tell of samples that are too few, constant, repeated or clipped. The other mistakes (wrong
    sampling period, swapped, shifted or sign-flipped columns, angles that begin anew after a turn, sizes
    without a sign, other units) are undone on trial: each is believed only if the simulator, refitted within
    45 % of its nominal parameters and with free initial states, then leaves at most a quarter of the error
    variance that it leaves otherwise, in four windows of five. A wrong parameter or a missing piece of
    physics does not do that.

    Parameters
    ----------
    simulator : Simulator
        The simulation as it stands.
    u : array-like or DataFrame of shape (n_samples, n_inputs)
        Measured inputs, columns of a table by name; NaN marks gaps.
    y : array-like or DataFrame of shape (n_samples,) or (n_samples, n_outputs)
        Measured outputs, in the order of the simulator's or by name; NaN marks gaps.
    sessions : array-like of shape (n_samples,), default=None
        One label a sample.
    n_jobs : int, default=None
        Threads that try mistakes side by side, as in joblib.

    Returns
    -------
    tuple of DataFinding
        Empty when nothing was found.

    Raises
    ------
    ValueError
        If the data do not fit the simulator.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.discrepancy import ODESimulator, check_record
    >>> def tank(x, u, p):
    ...     return (p[0] * u[0] - p[1] * x[0],)
    >>> sim = ODESimulator(tank, dt=0.1, parameters={"gain [m/s/V]": 1.0, "outflow [1/s]": 0.5},
    ...                    states=["level [m]"], inputs=["pump [V]"])
    >>> rng = np.random.default_rng(0)
    >>> u = np.repeat(rng.uniform(-1, 1, 100), 10)
    >>> y = 1000 * sim.simulate(u) + rng.normal(size=(1000, 1))
    >>> [finding.code for finding in check_record(sim, u, y)]
    ['units']
    """
    u = read_columns(u, simulator.inputs, "u", "input")
    y = read_columns(y, simulator.outputs, "y", "output")
    check_same_length(u=u, y=y, sessions=sessions)
    pieces = finite_slices(session_slices(sessions, u.shape[0]), finite_rows(u))
    found = counted(simulator, u, y, pieces)
    longest = max((piece.stop - piece.start for piece in pieces), default=0)
    if longest < fewest(simulator):
        return tuple(found)  # nothing can be compared
    case = make_case(simulator, u, y, pieces, n_jobs)
    if case is not None and np.nanstd(y, axis=0).min() > 0:
        mistakes, case, last = find_mistakes(case)
        if any(mistake.code == "time_scale" for mistake in mistakes):  # short only as the simulator counts
            found = [finding for finding in found if finding.code != "short_record"]
        turned = {mistake.about.get("output") for mistake in mistakes if mistake.code == "wrapped"}
        found = [f for f in found if not (f.code == "jump" and f.evidence["output"] in turned)]
        found += [mistake_in_words(simulator, mistake) for mistake in mistakes]
        if last is not None:
            found += other_units(simulator, case, last)
    return tuple(found)
