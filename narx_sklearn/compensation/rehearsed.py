"""The part of a compensator that rehearses its law on a model of the machine, and tells how it did."""

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np

from narx_sklearn._validation import as_signals
from narx_sklearn.compensation.law import CompensationLaw, LawRun, UnreachableWarning
from narx_sklearn.compensation.rehearsal import Rehearsal, Trial
from narx_sklearn.compensation.rehearsing import rehearse_on_record
from narx_sklearn.model.narx import NARXModel

__all__ = ["Rehearsed", "warn_if_worse"]


def warn_if_worse(rehearsal: Rehearsal | None, way_out: str, *, before: str = "") -> None:
    """Warn, as from the caller's caller, that a law does no better than a straight line, with the way out."""
    words = "" if rehearsal is None else rehearsal.worse_than_line
    if words:
        warnings.warn(f"{before}{words} {way_out}", UnreachableWarning, stacklevel=3)


class Rehearsed:
    """The part of a compensator that rehearses its law; see `Compensator` for the rest."""

    model: Any
    model_: Any
    law_: CompensationLaw
    rehearsal_: Rehearsal | None
    compensate: Callable[..., LawRun]
    _first_input: Callable[..., float]
    _driving: Callable[..., str]

    def rehearse(self, X, m_init=None) -> Trial | None:
        """Drive a model of the machine by the input along a reference, and by a straight line of it.

        Parameters
        ----------
        X : array-like of shape (n_samples,) or (n_samples, 1 + n_others)
            As for `predict`.
        m_init : float, default=None
            As for `predict`.

        Returns
        -------
        Trial or None
            How far the model stays from the reference; None where there is no model to be driven, or the
            reference never moves.

        Examples
        --------
        >>> import numpy as np
        >>> from narx_sklearn.compensation import RootCompensator
        >>> from narx_sklearn.model import NARXModel
        >>> model = NARXModel.from_equations("0.5*y[k-1] + 0.5*u[k-1]")
        >>> reference = np.sin(np.arange(200) / 10)
        >>> print(round(RootCompensator(model).fit().rehearse(reference).law, 9))
        0.0
        >>> print(round(RootCompensator(model, limits=(-0.5, 0.5)).fit().rehearse(reference).law, 1))
        0.5
        """
        return self._trial(self.compensate(X, m_init), as_signals(X, "X"), m_init)

    def _trial(self, run: LawRun, reference: np.ndarray, m_init) -> Trial | None:
        if self.rehearsal_ is None or np.ptp(reference[:, 0]) == 0.0:
            return None
        start = self._first_input(reference[0]) if m_init is None else float(m_init)
        return self.rehearsal_.judge(self.law_, run, reference, start)

    def _said_of(self, trial: Trial | None) -> str:
        """Say that a reference is lost, or better followed by a straight line, and the way out."""
        if trial is None or self.rehearsal_ is None or trial.is_bound:  # the counts tell of limits
            return ""
        words = self.rehearsal_.said_of(trial)
        return words and f"{words} {self._way_out()}"

    def _way_out(self) -> str:
        """Return what else could be tried where the law does not serve."""
        if self.model is None:
            return "Identify from a longer record that goes as slowly as the reference, or use the line."
        return (
            "Identify with structure='rate_independent', other lags or fewer terms, or pass no model and the "
            "record: of several models the one is taken whose law serves."
        )

    def _rehearse(self, X, y, sessions) -> Rehearsal | None:
        own = self.model_ if isinstance(self.model_, NARXModel) else None
        if X is None:
            return None if own is None else Rehearsal(own, self._driving(), is_own=True)
        driving = None if own is None else self._driving()
        return rehearse_on_record(self.law_, X, y, sessions, own=own, input_name=driving)
