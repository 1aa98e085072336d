"""What all compensators share: identify or take a model, derive the law, run it, explain it."""

import warnings
from dataclasses import replace
from numbers import Real
from types import NoneType
from typing import Any

import numpy as np
from sklearn.base import BaseEstimator
from sklearn.utils.validation import check_is_fitted

from narx_sklearn._validation import (
    as_signals,
    check_choice,
    check_indexes,
    check_same_length,
    column_labels,
    split_unit,
)
from narx_sklearn.compensation.beyond import beyond_record
from narx_sklearn.compensation.c_code import c_source
from narx_sklearn.compensation.choosing import (
    choose_model,
    fitted_regressor,
    parted,
    recorded_range,
)
from narx_sklearn.compensation.derive import check_width, static_powers
from narx_sklearn.compensation.holding import HoldingInput, middle_of_record, static_line
from narx_sklearn.compensation.law import (
    BRANCHES,
    POLICIES,
    CompensationLaw,
    LawRun,
    LawState,
    UnreachableWarning,
    warn_if_unreachable,
)
from narx_sklearn.compensation.rehearsed import Rehearsed, warn_if_worse
from narx_sklearn.compensation.rehearsing import CHECKED_SAMPLES
from narx_sklearn.compensation.stability import (
    warn_if_amplifying,
    warn_if_amplifying_at_rest,
    warn_if_run_away,
)
from narx_sklearn.exceptions import NarxWarning
from narx_sklearn.model.narx import NARXModel
from narx_sklearn.model.times import step_of_rows
from narx_sklearn.model.units import compare_units

CHOICES = {"policy": POLICIES, "branch": BRANCHES}  # of compensators that solve for their input


class Compensator(Rehearsed, BaseEstimator):
    """Base of the compensators; see `RootCompensator` for the contract."""

    def fit(self, X=None, y=None, sessions=None):
        """Identify the model, unless it is given, and derive the law.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_inputs), default=None
            Inputs that were applied to the machine. None where the model is given.
        y : array-like of shape (n_samples,), default=None
            Output that was measured. None where the model is given.
        sessions : array-like of shape (n_samples,), default=None
            One label a sample; where it changes, another recording begins.

        Returns
        -------
        self

        Raises
        ------
        ValueError
            If there are neither data nor a model, an argument is out of range, or the model allows no law.
        TypeError
            If ``model`` is neither a model nor an estimator of one, such as a simulator.

        Warns
        -----
        AmplificationWarning
            If the law amplifies small errors of its own input along the first samples of the record; or,
            where the model is given without one, at rest at the mean output that the model keeps of its own
            record, or else at zero.
        UnreachableWarning
            If the law, rehearsed on a model of the machine along the record's output slowed and made smaller,
            does no better than a straight line of the reference.
        """
        for learned in ("law_", "rehearsal_"):  # an interrupted fit leaves nothing that could be used
            self.__dict__.pop(learned, None)
        _check_is_no_simulator(self.model)
        limits, rate_limit = self._check_limits()
        check_width(getattr(self, "smooth_width", None), "smooth_width")
        choices = self._choices()
        for name, choice in choices.items():
            check_choice(choice, name, CHOICES[name])
        data = None
        if X is not None and y is not None:
            check_indexes(X, y)
            data = as_signals(X, "X"), as_signals(y, "y")
            check_same_length(X=data[0], y=data[1], sessions=sessions)
            if data[1].shape[1] != 1:
                raise ValueError(f"A compensator follows one output, y has {data[1].shape[1]} columns.")
            self.n_features_in_ = data[0].shape[1]
        law = self._identify_law(X, y, sessions)
        applied = None
        if data is not None:
            applied = self._parted(data[0])[0]
        if self.limits is None:
            limits = self._known_range(applied, needed=law.method == "search")
        self._held = self._holding(law, applied, None if data is None else data[1][:, 0])
        self._told = self._told_of(y, law)
        self.law_ = replace(
            law, limits=limits, rate_limit=rate_limit, keeps_rest=law.keeps_rest and self.keep_rest, **choices
        )
        self.reset()
        if data is not None:
            finite = data[1][np.isfinite(data[1]).all(axis=1)][:CHECKED_SAMPLES]
            if not self.law_.others:
                warn_if_amplifying(self.law_, finite, m=self._first_input(finite[0]))
        else:
            level = self._mean_of_record()
            warn_if_amplifying_at_rest(self.law_, level, m=self._first_input(level))
        self.rehearsal_ = self._rehearse(None if data is None else X, y, sessions) if self.rehearsed else None
        warn_if_worse(self.rehearsal_, self._way_out())
        return self

    def _identify_law(self, X, y, sessions) -> CompensationLaw:
        if isinstance(self.model, NARXModel):
            self.model_ = self.model
        elif isinstance(self.model, NoneType | list | tuple) and X is not None and y is not None:
            self.model_ = self._best_identified(X, y, sessions)
        else:
            self.regressor_ = fitted_regressor(self.model, X, y, sessions)
            self.model_ = self._model_of(self.regressor_, X, y, sessions)
        return self._derive(self.model_)

    def _best_identified(self, X, y, sessions) -> NARXModel:
        """Identify the machine in several ways; of models whose law serves return what predicts best."""
        asked = self.model
        if asked is None:
            asked = self._default_regressors(X, y, getattr(self, "input_name", None))
        model, self.regressor_ = choose_model(
            asked,
            X,
            y,
            sessions,
            lambda model: replace(self._derive(model), **self._choices()),
            input_name=getattr(self, "input_name", None),
            model_of=lambda regressor: self._model_of(regressor, X, y, sessions),
        )
        return model

    def _model_of(self, regressor, X, y, sessions) -> NARXModel:
        return regressor.model_

    def _holding(self, law: CompensationLaw, applied, y) -> HoldingInput:
        """Return what is known of the inputs that hold the machine: from the record, or the model's own."""
        model, followed = self.model_, self._followed()
        points = static = None
        if isinstance(model, NARXModel):
            static = static_powers(model, self._driving())
            if applied is None:
                points = middle_of_record(model, followed, self._driving())
        return HoldingInput(
            signals=(followed, *self._other_inputs(law)),
            is_continuum=law.keeps_rest,
            line=None if applied is None else static_line(applied, y),
            points=points,
            static=static,
        )

    def _choices(self) -> dict[str, Any]:
        return {name: getattr(self, name) for name in CHOICES if hasattr(self, name)}

    def predict(self, X, m_init=None):
        """Return the input that makes the machine follow a reference.

        Parameters
        ----------
        X : array-like of shape (n_samples,) or (n_samples, 1 + n_others)
            Reference, in the unit of the output; with a model of several inputs the others beside it. It may
            be read ahead, and is held after its end.
        m_init : float, default=None
            Input held before the first sample. None takes the one that holds the first reference: the
            solution of the model's static equation, all its signals held. Of several solutions within
            ``limits`` it is the nearest to the straight line through the record, or between the least, the
            mean and the largest values that the model keeps of it (``model.recorded``), or without either to
            zero, where there is none the input that comes nearest to solving it. A model with functions of
            the user's or with memory has no such equation: its law is run until it settles.
            Where the model can rest anywhere, every input holds; it is then the one on that line. Without a
            record it is as large as the first reference, though in another unit: pass ``m_init``.

        Returns
        -------
        ndarray of shape (n_samples,)
            Compensation input, in the unit of the machine's input.

        Raises
        ------
        ValueError
            If the reference has gaps, other columns than the law needs, a label that states another unit
            than the output's, or times that go back.

        Warns
        -----
        NarxWarning
            If a label states a unit that is not known to be the output's, or a time index another sampling
            period than the model's, or rows that are missing, uneven or out of order.
        UnreachableWarning
            If no admissible input satisfied the law at some samples, or ``limits`` or ``rate_limit`` cut it;
            if the first reference, at which the model may rest, lies beyond what was recorded; if the law
            runs away: it amplifies its errors, and its input left a thousand times the recorded range, or
            the range of the inputs that hold the reference; if not even the model follows the reference,
            driven by this input, or on a model of the machine a straight line follows it better; or if the
            reference goes clearly farther, or changes clearly faster, than the output in the record that the
            model is from.
        """
        run = self.compensate(X, m_init)
        reference = as_signals(X, "X")
        begun = (
            m_init is None and self._held.is_continuum and self._warn_if_begun_beyond(float(reference[0, 0]))
        )
        if not np.isfinite(
            self.law_.limits
        ).all() and warn_if_run_away(  # else the limits that cut it are told
            self.law_, reference, run.m, self._usual_inputs(reference, m_init)
        ):
            return run.m
        beside = [self._said_of(self._trial(run, reference, m_init)), "" if begun else self.beyond_record(X)]
        warn_if_unreachable(run.counts, self.law_, " ".join(filter(None, beside)))
        return run.m

    def beyond_record(self, X):
        """Say where a reference goes farther or changes faster than the record that the model is from.

        One that never moves asks nothing of a model that can rest anywhere.

        Parameters
        ----------
        X : array-like of shape (n_samples,) or (n_samples, 1 + n_others)
            As for `predict`.

        Returns
        -------
        str
            Empty where it does not, or where the model keeps no record.
        """
        check_is_fitted(self, "law_")
        model = self.model_
        if not isinstance(model, NARXModel):
            return ""
        name = self._followed()
        known = model.recorded.get(name), model.recorded_change.get(name)
        reference = as_signals(X, "X")[:, 0]
        if self._held.is_continuum and np.all(reference == reference[0]):
            return ""
        return beyond_record(reference, *known)

    def compensate(self, X, m_init=None) -> LawRun:
        """Return the input along a reference with the counts of what could not be had.

        Parameters
        ----------
        X : array-like of shape (n_samples,) or (n_samples, 1 + n_others)
            As for `predict`.
        m_init : float, default=None
            As for `predict`.

        Returns
        -------
        LawRun
        """
        check_is_fitted(self, "law_")
        reference = as_signals(X, "X")
        self._check_units(X)
        self._check_times(X)
        if reference.shape[1] != len(self.law_.known):
            raise ValueError(
                f"X has {reference.shape[1]} columns; the law needs {len(self.law_.known)}: the reference"
                f"{''.join(', ' + s for s in self._other_inputs(self.law_))}."
            )
        if not np.all(np.isfinite(reference)):
            row = int(np.flatnonzero(~np.isfinite(reference).all(axis=1))[0])
            raise ValueError(
                f"The reference is not finite at sample {row}; a machine needs one at every sample. "
                "Interpolate the gap or compensate the parts by themselves."
            )
        start = self._first_input(reference[0]) if m_init is None else float(m_init)
        _check_finite(m_init=start)
        return self.law_.run(reference, m=start)

    def reset(self, reference=0.0, m=None):
        """Set the state that `step` goes on from.

        Parameters
        ----------
        reference : float or array-like of shape (n_past,), default=0.0
            Reference up to the newest known sample, ``k + horizon - 1`` for a first step at k. A number, or
            what lies before the array, has been held.
        m : float or array-like, default=None
            Inputs up to sample ``k - 1``, a warm start; a number has been held. None takes the input that
            holds the first reference.

        Returns
        -------
        self
        """
        check_is_fitted(self, "law_")
        known = np.asarray(reference, dtype=float)
        known = known.reshape(-1, len(self.law_.known)) if known.size > 1 else known.reshape(1, -1)
        known = np.broadcast_to(known, (known.shape[0], len(self.law_.known)))
        _check_finite(reference=known)
        past = np.atleast_1d(np.asarray(self._first_input(known[0]) if m is None else m, dtype=float))
        _check_finite(m=past)
        n_rows = max(known.shape[0], past.size)
        known = np.concatenate([np.repeat(known[:1], n_rows - known.shape[0], axis=0), known])
        past = np.concatenate([np.full(n_rows - past.size, past[0]), past])
        self._state = self.law_.start(past[0], known[0])
        self._state.settle(known[1:], past[1:])
        return self

    def step(self, reference_ahead):
        """Compute one input, on line; the state is carried from call to call.

        Parameters
        ----------
        reference_ahead : float or array-like of shape (1 + n_others,)
            Reference ``law_.horizon`` samples ahead of the input wanted (and other known signals, then). What
            is not finite is taken as it was last, and counted with the samples without a solution.

        Returns
        -------
        float
            The input to apply now.
        """
        try:
            return self._state.step(reference_ahead)
        except AttributeError:
            check_is_fitted(self, "law_")
            raise

    @property
    def counts(self):
        """How often `step` could not have its way since the last `reset`."""
        check_is_fitted(self, "law_")
        return self._state.counts

    def explain(self, form="equation", name="compensator"):
        """Return the law as text.

        Parameters
        ----------
        form : {"equation", "c"}, default="equation"
            Equations to read, and how the law did in rehearsal; or a C99 program part that computes the same
            numbers: functions ``<name>_reset`` and ``<name>_step``, no memory allocation, only ``math.h``.
        name : str, default="compensator"
            Prefix of the names in C.

        Returns
        -------
        str
        """
        check_is_fitted(self, "law_")
        check_choice(form, "form", ("equation", "c"))
        if form == "c":
            return c_source(self.law_, name)
        rehearsed = self.rehearsal_ is not None and self.rehearsal_.trials
        return f"{self.law_}\n{self.rehearsal_}" if rehearsed else str(self.law_)

    def score(self, X, y):
        """Return R² of the recorded input, computed from the recorded output as the reference.

        Parameters
        ----------
        X : array-like of shape (n_samples, 1)
            Input that was applied to the machine.
        y : array-like of shape (n_samples,)
            Output that was measured; taken as the reference.

        Returns
        -------
        float
            1 when the law gives back the very input. Noise of the output counts as reference here; to judge
            by what a compensator does to a plant use `tracking_scorer`.
        """
        check_is_fitted(self, "law_")
        check_indexes(X, y)
        u = as_signals(X, "X")
        applied, others = self._parted(u)
        m = self.compensate(np.column_stack([as_signals(y, "y"), others]), m_init=applied[0]).m
        return float(1.0 - np.sum((applied - m) ** 2) / np.sum((applied - applied.mean()) ** 2))

    def _told_of(self, y, law: CompensationLaw) -> tuple[tuple[str, str], ...]:
        """Return, in words and with its unit, what the reference and each other known signal stands for."""
        units = getattr(self.model_, "units", {})
        label = (column_labels(y) or [None])[0]
        labelled, unit = split_unit(label) if isinstance(label, str) else (None, None)
        followed = self._followed()
        told = [("output", labelled or followed, units.get(followed) or unit or "")]
        told += [("input", name, units.get(name, "")) for name in self._other_inputs(law)]
        return tuple((f"the model's {role} '{name} [{unit}]'", unit) for role, name, unit in told)

    def _followed(self) -> str:
        """Return what the model calls the output that follows the reference."""
        return getattr(self.model_, "outputs", ("y",))[0]

    def _parted(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the input that compensates, and the other inputs."""
        return parted(u, self.model_, getattr(self, "input_name", None))

    def _driving(self) -> str:
        """Return what the model calls the input that compensates."""
        return getattr(self, "input_name", None) or self.model_.inputs[0]

    def _recorded(self) -> tuple[Any, Any]:
        """Return least, mean and largest value of output and input in the model's own record, as known."""
        if not isinstance(self.model_, NARXModel):
            return None, None
        return self.model_.recorded.get(self._followed()), self.model_.recorded.get(self._driving())

    def _warn_if_begun_beyond(self, first: float) -> bool:
        outputs = self._recorded()[0]
        beyond = outputs is not None and not outputs[0] <= first <= outputs[2]
        if not self._held.is_recorded and first != 0.0:
            warnings.warn(
                f"The model can rest anywhere and keeps no record that tells which input holds {first:g}, "
                f"where the reference begins; it begins at an input of {self._first_input(first):g}. Pass "
                "m_init, or fit the compensator with the record.",
                UnreachableWarning,
                stacklevel=3,
            )
        if outputs is not None and beyond:
            warnings.warn(
                f"The reference begins at {first:g}, beyond the recorded output, {outputs[0]:g} to "
                f"{outputs[2]:g}: which input holds it there is not known. Let it "
                "begin within, or pass m_init.",
                UnreachableWarning,
                stacklevel=3,
            )
        return beyond

    def _check_units(self, X) -> None:
        for label, (whose, wanted) in zip(column_labels(X) or [], self._told, strict=False):
            given = split_unit(label)[1] if isinstance(label, str) else None
            words = compare_units(f"The reference's column {label!r}", given or "", whose, wanted)
            if words:
                warnings.warn(words, NarxWarning, stacklevel=4)

    def _check_times(self, X) -> None:
        period = getattr(self.model_, "sampling_period", None)
        step_of_rows({"X": X}, None, period, "the model by sampling_period", stacklevel=4)

    def _first_input(self, known) -> float:
        """Return the input that holds the first reference, as far as the law or the record know it."""
        return self._held.at(known, self.law_)

    def _usual_inputs(self, reference: np.ndarray, m_init) -> list[float]:
        """Return the input before the first sample, and between which inputs a reference is usually followed.

        These are the ends of the recorded range; where none is known, the inputs that hold the least and the
        largest reference.
        """
        start = self._first_input(reference[0]) if m_init is None else float(m_init)
        recorded = self._recorded()[1]
        if recorded is not None:
            return [start, recorded[0], recorded[2]]
        ends = reference[:, 0].argmin(), reference[:, 0].argmax()
        return [start, *(self._first_input(reference[k]) for k in ends)]

    def _mean_of_record(self) -> np.ndarray:
        """Return the mean of the followed output and of the other inputs, zero where no record tells."""
        recorded = getattr(self.model_, "recorded", {})
        names = self._followed(), *self._other_inputs(self.law_)
        return np.array([recorded.get(name, (0.0, 0.0, 0.0))[1] for name in names])

    def _other_inputs(self, law: CompensationLaw) -> tuple[str, ...]:
        """Return what the model calls the other known signals of a law."""
        return tuple(s for s in self.model_.inputs if s != self._driving()) if law.others else ()

    def _check_limits(self) -> tuple[tuple[float, float], float]:
        given = (-np.inf, np.inf) if self.limits is None else self.limits
        is_pair = np.shape(given) == (2,) and all(isinstance(x, Real) for x in given)
        if not is_pair or not given[0] < given[1]:
            raise ValueError(f"limits must be a pair (low, high) with low < high, got {self.limits!r}.")
        limits = float(given[0]), float(given[1])
        rate = np.inf if self.rate_limit is None else self.rate_limit
        if not isinstance(rate, Real) or isinstance(rate, bool) or not float(rate) > 0.0:
            raise ValueError(f"rate_limit must be positive (or None), got {self.rate_limit!r}.")
        return limits, float(rate)

    def _known_range(self, applied, *, needed: bool) -> tuple[float, float]:
        """Return the range of the input in the record, or in the one that the model is from."""
        recorded = self._recorded()[1]
        if applied is None and recorded is not None:
            return recorded[0], recorded[2]
        return self._range_of(applied) if applied is not None or needed else (-np.inf, np.inf)

    @staticmethod
    def _range_of(applied) -> tuple[float, float]:
        if applied is None:
            raise ValueError(
                "The law of this model is searched, which needs limits=(low, high): the range of the input. "
                "They are taken from the data where fit gets data, or from model.recorded."
            )
        return recorded_range(applied)

    def __sklearn_is_fitted__(self):
        return hasattr(self, "law_")

    def __getstate__(self):
        content = super().__getstate__()
        content.pop("_state", None)
        return content

    def __setstate__(self, content):
        super().__setstate__(content)
        if "law_" in content:
            self.reset()


def _check_is_no_simulator(model: Any) -> None:
    """Refuse what can be simulated but is no NARX model, and say how to get one from it."""
    kind = type(model).__name__
    if hasattr(model, "to_narx"):
        raise TypeError(
            f"model is a {kind}, but a compensator solves the equation of a NARX model: fit it and pass "
            "model=dx.to_narx(X) of the fitted dx, with inputs X that reach what the model is to know."
        )
    if hasattr(model, "simulate") and not hasattr(model, "fit"):
        raise TypeError(
            f"model is a simulator ({kind}), but a compensator solves the equation of a NARX model: pass "
            "model=dx.to_narx(X) of the fitted DiscrepancyRegressor dx that corrected it, or the model_ of a "
            "NARXRegressor fitted to X and simulator.simulate(X)."
        )


def _check_finite(**values) -> None:
    for name, value in values.items():
        if not np.all(np.isfinite(value)):
            raise ValueError(f"{name} must be finite, got {value!r}; a machine cannot have been held there.")


__all__ = ["Compensator", "LawState"]
