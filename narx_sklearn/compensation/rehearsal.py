"""A law rehearsed on a model of the machine, beside a straight line of the reference."""

import warnings
from dataclasses import dataclass, replace

import numpy as np

from narx_sklearn._validation import session_slices
from narx_sklearn.compensation.law import CompensationLaw, LawRun
from narx_sklearn.exceptions import DivergenceWarning
from narx_sklearn.model.narx import NARXModel
from narx_sklearn.model.polynomials import Polynomial
from narx_sklearn.model.simulation import free_run

__all__ = ["Rehearsal", "Trial", "straight_line"]

# A law that only repeats its record follows it at the record's own speed and size.
DOUBLINGS = {"half": 1, "an eighth of": 3}  # how often a reference is slowed to half its speed
SIZES = {"half": 0.5, "a quarter of": 0.25}
REHEARSED = 2000  # samples of the record that are slowed
LOST = 0.2  # of the reference's deviation: a law that leaves more on its own model has lost the reference
FAR = 10.0  # deviations, beyond which a model runs away from its reference


@dataclass(frozen=True)
class Trial:
    """How far a model of the machine stays from one reference, under a law and under a straight line.

    Attributes
    ----------
    reference : str
        The reference in words.
    law, line : float
        Root mean squared distances from it, in its deviations; infinite where the model leaves the finite
        range, NaN where there is no line.
    deviation : float
        Standard deviation of the reference, in the unit of the output.
    doubt : float
        How far the model itself stays from its record, in the same measure as ``law``; 0 where that is not
        known.
    unsolved : float
        Share of the samples at which no admissible input solved the law.
    is_bound : bool
        Whether the law would follow without its limits and its rate limit.
    """

    reference: str
    law: float
    line: float
    deviation: float
    doubt: float = 0.0
    unsolved: float = 0.0
    is_bound: bool = False

    @property
    def is_worse(self) -> bool:
        """Whether the law is worse than the line by more than the model can be wrong about both."""
        return self.law > self.line + 2.0 * self.doubt


@dataclass(frozen=True, eq=False)
class Rehearsal:
    """A law on a model of the machine, beside a straight line of the reference.

    Attributes
    ----------
    machine : NARXModel
        The model that is driven.
    driven : str
        What it calls the input that the law gives.
    is_own : bool
        Whether the law was derived from it. Such a law follows every reference on it, but where its equation
        has no admissible solution, or it amplifies its errors.
    line : CompensationLaw or None, default=None
        The input of the record as a straight line of its output, read as far ahead as the law reads the
        reference, within the same limits.
    error : float, default=0.0
        Root mean squared error of the model's free run on the record.
    trials : tuple of Trial, default=()
        Along the record's output, slowed and made smaller.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.compensation import CompensationLaw, Rehearsal
    >>> from narx_sklearn.model import NARXModel, Polynomial
    >>> machine = NARXModel.from_equations("2*u[k-1]")
    >>> u = np.sin(2 * np.pi * np.arange(1001) / 100)
    >>> law = CompensationLaw("explicit", (Polynomial.parse("1.5*r[k+1]"),))
    >>> rehearsal = Rehearsal.of(law, machine, u, np.append(0.0, 2 * u[:-1]))
    >>> print(rehearsal)
    On a model of the machine the law leaves 200% of a reference's deviation, a straight line of it 0%.
    """

    machine: NARXModel
    driven: str
    is_own: bool
    line: CompensationLaw | None = None
    error: float = 0.0
    trials: tuple[Trial, ...] = ()

    @classmethod
    def of(cls, law, machine, u, y, sessions=None, *, driven=None, is_own=False) -> "Rehearsal":
        """Rehearse a law on slower and smaller copies of what a model says of the record.

        Parameters
        ----------
        law : CompensationLaw
            The law.
        machine : NARXModel
            A model of the machine, of one output.
        u : array-like of shape (n_samples,) or (n_samples, n_inputs)
            Inputs of the record.
        y : array-like of shape (n_samples,) or (n_samples, 1)
            Output of the record.
        sessions : array-like of shape (n_samples,), default=None
            One label a sample.
        driven : str or None, default=None
            What the model calls the input that the law gives; None is its first.
        is_own : bool, default=False
            Whether the law was derived from this model.

        Returns
        -------
        Rehearsal
            Without trials where the model's free run of the record leaves the finite range, or the record
            does not move.
        """
        u, y = np.asarray(u, dtype=float).reshape(len(u), -1), np.asarray(y, dtype=float).reshape(-1, 1)
        driven = machine.inputs[0] if driven is None else driven
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DivergenceWarning)
            run = free_run(machine, u, y_init=y, sessions=sessions)
        column = machine.inputs.index(driven)
        others = np.delete(u, column, axis=1)
        line = straight_line(law, u[:, column], np.column_stack([y, others]), sessions)
        both = np.isfinite(run.y) & np.isfinite(y)
        if run.stopped_at is not None or line is None or not both.any():
            return cls(machine, driven, is_own)
        error = float(np.sqrt(np.mean((run.y - y)[both] ** 2)))
        found = cls(machine, driven, is_own, line, error)
        stretch = _liveliest(np.column_stack([run.y, others]), sessions)
        if stretch.shape[0] <= law.horizon + machine.max_lag or np.ptp(stretch[:, 0]) == 0.0:
            return found
        trials = []
        for size, factor in SIZES.items():
            for speed, n_times in DOUBLINGS.items():
                known = stretch.mean(axis=0) + factor * (stretch - stretch.mean(axis=0))
                for _ in range(n_times):
                    known = at_half_speed(known)
                start = float(line.run(known[:1]).m[0])
                words = f"the record's output at {speed} its speed and {size} its size"
                trials.append(found.follow(law.run(known, m=start), known, start, words))
        # a line that drives the model away says that the model is no judge there
        return replace(found, trials=tuple(trial for trial in trials if np.isfinite(trial.line)))

    def follow(self, run: LawRun, known: np.ndarray, start: float, reference="this reference") -> Trial:
        """Drive the model by what a law gave along a reference, and by the line.

        Parameters
        ----------
        run : LawRun
            What the law gave.
        known : ndarray of shape (n_samples, 1 + n_others)
            Reference, and the other inputs.
        start : float
            Input held before the first sample.
        reference : str, default="this reference"
            The reference in words.

        Returns
        -------
        Trial
        """
        size = float(np.std(known[:, 0])) or 1.0
        line = np.nan
        if self.line is not None:
            straight = self.line.run(known).m
            line = self._missed(straight, known, straight[0]) / size
        return Trial(
            reference,
            law=self._missed(run.m, known, start) / size,
            line=line,
            deviation=size,
            doubt=self.error / size,
            unsolved=run.counts.no_solution / max(run.counts.samples, 1),
        )

    def judge(self, law: CompensationLaw, run: LawRun, known: np.ndarray, start: float) -> Trial:
        """Drive the model as `follow` does; where the law loses the reference, tell whether limits make it.

        Parameters
        ----------
        law : CompensationLaw
            The law.
        run, known, start
            As for `follow`.

        Returns
        -------
        Trial
        """
        trial = self.follow(run, known, start)
        if not self.has_lost(trial):
            return trial
        wide = law.limits if law.method == "search" else (-np.inf, np.inf)
        unbound = replace(law, limits=wide, rate_limit=np.inf).run(known, m=start)
        return replace(trial, is_bound=not self.has_lost(self.follow(unbound, known, start)))

    def _missed(self, m: np.ndarray, known: np.ndarray, start: float) -> float:
        """Return the distance of the model's output from the reference, both held before the first sample."""
        lag = self.machine.max_lag
        held = np.concatenate([np.full(lag, start), m])
        others = np.concatenate([np.repeat(known[:1, 1:], lag, axis=0), known[:, 1:]])
        inputs = np.insert(others, self.machine.inputs.index(self.driven), held, axis=1)
        with warnings.catch_warnings(), np.errstate(over="ignore", invalid="ignore"):
            warnings.simplefilter("ignore", DivergenceWarning)  # the distance says it
            y = free_run(self.machine, inputs, np.full(lag, known[0, 0])).y[lag:, 0]
            missed = float(np.sqrt(np.mean((y - known[:, 0]) ** 2)))
        return missed if np.isfinite(missed) else np.inf

    @property
    def worst(self) -> Trial | None:
        """The trial in which the law leaves most beyond what the line leaves; None without trials."""
        return max(self.trials, key=lambda trial: (trial.is_worse, trial.law - trial.line), default=None)

    @property
    def worse_than_line(self) -> str:
        """Sentences that say where the law is worse than the line; empty where it is not."""
        worst = self.worst
        if worst is None or not worst.is_worse or self.line is None:
            return ""
        unsolved = f" At {worst.unsolved:.0%} of its samples no admissible input solves the law."
        return (
            "The law does no better than a straight line. "
            f"{_beside_line(worst, self.line)}{unsolved if worst.unsolved >= 0.01 else ''}"
        )

    @property
    def left(self) -> float:
        """What the law leaves of all references together, in their deviation; NaN without trials.

        What the model itself errs on its record is the least that it can tell.
        """
        size = sum(t.deviation**2 for t in self.trials)
        missed = sum((t.law * t.deviation) ** 2 for t in self.trials)
        least = len(self.trials) * self.error**2
        return float(np.sqrt(max(missed, least) / size)) if self.trials else np.nan

    def has_lost(self, trial: Trial) -> bool:
        """Tell whether a law has lost a reference on its own model, where it would follow if it could."""
        return self.is_own and trial.law > LOST

    def said_of(self, trial: Trial) -> str:
        """Say of a trial that the law has lost its reference, or is worse than the line; empty where not."""
        if self.has_lost(trial):
            how = f"stays {trial.law:.0%} of its deviation away from it"
            limits = " Limits keep the law from it: widen them, or ask for less."
            return (
                "Driven by this input not even the model follows the reference: it "
                f"{how if trial.law < FAR else 'runs away from it'}. The law has lost it, and the machine "
                f"will not follow either.{limits if trial.is_bound else ''}"
            )
        return _beside_line(trial, self.line) if trial.is_worse and self.line is not None else ""

    def __str__(self) -> str:
        if not self.trials:
            return "Nothing could be rehearsed: there is no record, or no model that simulates it."
        law, line = ([getattr(trial, name) for trial in self.trials] for name in ("law", "line"))
        return (
            f"On a model of the machine the law leaves {_span(law)} of a reference's deviation, a straight "
            f"line of it {_span(line)}."
        )


def straight_line(law: CompensationLaw, u, known, sessions) -> CompensationLaw | None:
    """Return the input of a record as a straight line of what a law knows, read as far ahead.

    Parameters
    ----------
    law : CompensationLaw
        The law that the line is to be compared with; its limits are those of the line.
    u : ndarray of shape (n_samples,)
        Input of the record.
    known : ndarray of shape (n_samples, 1 + n_others)
        Output of the record, and the other inputs.
    sessions : array-like of shape (n_samples,) or None
        One label a sample.

    Returns
    -------
    CompensationLaw or None
        None where the record has no two samples to draw it through.
    """
    ahead = law.horizon
    pieces = session_slices(sessions, u.size)
    read = np.concatenate([known[p][ahead:] for p in pieces])
    applied = np.concatenate([u[p][: max(p.stop - p.start - ahead, 0)] for p in pieces])
    rows = np.isfinite(read).all(axis=1) & np.isfinite(applied)
    if rows.sum() < 2:
        return None
    # about the means, so that an output far from zero costs no digits
    read, applied = read[rows], applied[rows]
    slopes = np.linalg.lstsq(read - read.mean(axis=0), applied - applied.mean(), rcond=None)[0]
    lag = f"[k+{ahead}]" if ahead else "[k]"
    terms = {f"{name}{lag}": float(slope) for name, slope in zip(law.known, slopes, strict=True)}
    equation = Polynomial({"1": float(applied.mean() - read.mean(axis=0) @ slopes), **terms})
    return CompensationLaw(
        "explicit", (equation,), others=law.others, limits=law.limits, rate_limit=law.rate_limit
    )


def at_half_speed(signals: np.ndarray) -> np.ndarray:
    """Return signals of shape (n_samples, n_signals) with a sample put between any two."""
    return np.stack([signals[:-1], 0.5 * (signals[:-1] + signals[1:])], axis=1).reshape(-1, signals.shape[1])


def _liveliest(signals: np.ndarray, sessions) -> np.ndarray:
    """Return the part without a gap, of at most so many samples as are rehearsed, that moves most."""
    parts = [signals[:0]]
    for piece in session_slices(sessions, signals.shape[0]):
        inside = signals[piece]
        gaps = np.flatnonzero(~np.isfinite(inside).all(axis=1))
        for whole in np.split(inside, np.unique([*gaps, *(gaps + 1)])):
            whole = whole[np.isfinite(whole).all(axis=1)]
            parts += [whole[i : i + REHEARSED] for i in range(0, len(whole), REHEARSED)]
    return max(parts, key=lambda part: part[:, 0].std() if len(part) else -1.0)


def _span(shares: list[float]) -> str:
    low, high = (f"{share:.0%}" if share < FAR else "all" for share in (min(shares), max(shares)))
    return low if low == high else f"{low} to {high}"


def _beside_line(trial: Trial, line: CompensationLaw) -> str:
    left = f"leaves {trial.law:.0%} of the deviation of" if trial.law < FAR else "runs away from"
    return (
        f"On a model of the machine the law {left} {trial.reference}; the straight line {line.equations[0]} "
        f"leaves {trial.line:.0%} of it."
    )
