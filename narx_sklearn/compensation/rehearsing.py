"""On which model a fitted law is rehearsed: its own, or another of the same record."""

import warnings
from functools import partial

import numpy as np

from narx_sklearn._validation import as_signals
from narx_sklearn.compensation._defaults import rehearsal_regressors
from narx_sklearn.compensation.choosing import choose_model, input_error, parted
from narx_sklearn.compensation.derive import root_law
from narx_sklearn.compensation.law import CompensationLaw
from narx_sklearn.compensation.rehearsal import Rehearsal
from narx_sklearn.model.narx import NARXModel
from narx_sklearn.model.simulation import free_run

__all__ = ["CHECKED_SAMPLES", "machine_for_rehearsal", "rehearse_on_record"]

CHECKED_SAMPLES = 5000  # of the record, on which a fitted law is checked


def rehearse_on_record(
    law: CompensationLaw,
    X,
    y,
    sessions,
    *,
    own: NARXModel | None = None,
    other: NARXModel | None = None,
    input_name: str | None = None,
) -> Rehearsal | None:
    """Rehearse a law on its own model, or where that cannot tell, on another of the same record.

    On its own model a law is right by construction; where it takes other inputs than those recorded for the
    output recorded, only another model can tell whether they are as good. So it does where its own model is
    driven away by a straight line.

    Parameters
    ----------
    law : CompensationLaw
        The law, with its limits.
    X, y, sessions
        The record.
    own : NARXModel or None, default=None
        The model of the machine that the law is from; None for a law that is from no such model.
    other : NARXModel or None, default=None
        Another model of the machine; None identifies one where it is needed.
    input_name : str or None, default=None
        The input that the law gives; None is the first.

    Returns
    -------
    Rehearsal or None
        None where there is no model of the machine, and none can be had.
    """
    u, measured = as_signals(X, "X"), as_signals(y, "y")
    found = None
    if own is not None:
        found = Rehearsal.of(law, own, u, measured, sessions, driven=input_name, is_own=True)
        if found.line and found.trials and _gives_back(law, found.line, found, u, measured, sessions):
            return found
    if other is None:
        other = machine_for_rehearsal(X, y, sessions, input_name)
    if other is None:
        return found
    column = 0 if own is None or input_name is None else own.inputs.index(input_name)
    on_other = Rehearsal.of(law, other, u, measured, sessions, driven=other.inputs[column])
    return on_other if on_other.trials or found is None else found


def machine_for_rehearsal(
    X, y, sessions, input_name: str | None = None, regressors=rehearsal_regressors
) -> NARXModel | None:
    """Identify a model of the machine on which laws are rehearsed; None where none can be had."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # it is asked, not used
        try:
            several = regressors(X, y, input_name)
            model, _ = choose_model(
                several, X, y, sessions, partial(root_law, input_name=input_name), input_name=input_name
            )
        except ValueError:
            return None
    return model


def _gives_back(law: CompensationLaw, line: CompensationLaw, own: Rehearsal, u, y, sessions) -> bool:
    """Tell whether a law gives the recorded input back better than a straight line, from its output."""
    part = slice(CHECKED_SAMPLES)
    u, y, sessions = u[part], y[part], None if sessions is None else np.asarray(sessions)[part]
    simulated = free_run(own.machine, u, y_init=y, sessions=sessions).y
    applied, others = parted(u, own.machine, own.driven)
    reference = np.column_stack([simulated, others])
    of_law, of_line = (input_error(one, reference, applied, sessions) for one in (law, line))
    return of_law <= of_line
