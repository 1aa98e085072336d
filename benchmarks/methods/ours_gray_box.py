"""What a user of each machine knows of it, put into a NARX model; the training record gives all parameters.

Each recipe starts from a model with the right kinds of terms and rough parameters, fits it to the free run,
and makes it richer for as long as the free run on the validation part of the training record gets better. The
knowledge given is the first paragraph of each function. Values are never given, except for the corner
frequencies of the filters in `wiener_hammerstein`, which are its start.

Silverbox and F-16 have no recipe: the search on any recording finds polynomials that need no more.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from harness.recordings import RECORDINGS, SearchSpec
from harness.search import free_run_rmse
from scipy.signal import cheby1, cheby2

from methods.ours_hidden import Condition, Equations, build, conditions, equations_of, extended, lags
from methods.ours_state import OurModel, fit_free_run
from narx_sklearn import NARXRegressor
from narx_sklearn.model import AbsoluteDifference, Difference, NARXModel, Phi, SmoothSign

MAX_CURVES = 6
WORTH = 0.97  # a term that leaves more of the validation error than this is not worth having


@dataclass(frozen=True)
class _Trainer:
    """Fits models to one training record and judges them on its validation part."""

    X: np.ndarray
    y: np.ndarray
    spec: SearchSpec
    frame: OurModel  # how models see the recorded signals
    known: Callable[[NARXModel], Sequence[Condition]] = lambda model: ()
    head: int = 50
    skip: int = 0
    rounds: int = 2
    horizons: tuple[int | None, ...] = (None,)

    def fit(self, model: NARXModel, part: slice, **settings) -> OurModel:
        """Fit to the free run of a part of the record; samples at the sensor's limit say nothing."""
        u, step = self.frame.inputs(self.X)[: len(self.y)], self.frame.decimation
        y = np.where(self.y >= self.frame.highest, np.nan, self.y)[part][::step]
        u = u[part.start // step :][: len(y)]
        wanted = self.known(model)
        own = {name: getattr(self, name) for name in ("head", "skip", "rounds", "horizons")}
        fit, start = fit_free_run(
            model, u, y, constraints=conditions(model, wanted) if wanted else None, **own | settings
        )
        found = {"fit_rmse": start.sigma, "converged": fit.converged, "equations": str(fit.model)}
        return replace(self.frame, model=fit.model, start=start, search=found)

    def judge(self, model: OurModel) -> float:
        """Return the free-run error on the validation part."""
        part = self.spec.validation
        return free_run_rmse(model, self.X[part], self.y[part], self.spec.n_state)

    def trial(self, model: NARXModel, **settings) -> tuple[float, OurModel | None]:
        """Fit on the search part and judge."""
        try:
            fitted = self.fit(model, self.spec.fit, **settings)
        except FloatingPointError:
            return np.inf, None
        return self.judge(fitted), fitted

    def climb(self, model: NARXModel, steps: Sequence[Equations]) -> OurModel:
        """Add groups of terms, in the order given, as long as the judgement gets better."""
        error, best = self.trial(model)
        for more in steps:
            trial_error, trial = self.trial(extended(best.model, more))
            if not trial_error < WORTH * error:
                break
            error, best = trial_error, trial
        return best

    def finish(self, model: NARXModel, **settings) -> OurModel:
        """Fit on the whole training record."""
        return self.fit(model, self.spec.final, **settings)


def bouc_wen(X: np.ndarray, y: np.ndarray, spec: SearchSpec) -> OurModel:
    """A mass on a spring and a hysteretic force z with z' = a y' - b |y'| z - c y' |z| (Bouc-Wen, nu = 1).

    No values are given: the start is a linear model with half of its stiffness taken to be hysteretic. z is
    counted in the displacement that it would cause; the signal s adds it up, so that z and |z| are phi
    regressors. z[k-1] reads y up to k-2: the step from there is in the equation of y.
    """
    train = _Trainer(
        X, y, spec, OurModel(None), known=lambda model: [({("s", "s[k-1]"): 1.0}, 1.0)], skip=200
    )
    phi = [
        Difference("s", name="z"),
        AbsoluteDifference("s", name="za"),
        Difference("y", name="v"),
        AbsoluteDifference("y", name="va"),
    ]
    linear = NARXRegressor(2, 2, delay=0, degree=1, n_terms=5, refine=True, fit_intercept=False)
    start = equations_of(linear.fit(X[spec.fit, None], y[spec.fit]).model_)["y"]
    half = 0.5 * (1.0 - start["y[k-1]"] - start["y[k-2]"])
    turn = 0.01 / np.std(np.diff(y))  # a per cent of z is lost in a typical step
    start["y[k-2]"] += half
    start |= {"z[k-1]": -half, "va[k-1]*z[k-1]": 0.01 * turn, "v[k-1]*za[k-1]": 0.01 * turn}
    force = {"s[k-1]": 1.0, "z[k-1]": 1.0, "v[k-1]": 1.0, "va[k-1]*z[k-1]": -turn, "v[k-1]*za[k-1]": turn}
    small = 1e-3 * turn
    older = ("va[k-1]*z[k-2]", "v[k-1]*za[k-2]", "va[k-2]*z[k-1]", "v[k-2]*za[k-1]")
    steps: list[Equations] = [
        {"s": dict.fromkeys(older, small) | {"v[k-2]": 1e-3}},
        {"y": {"y[k-3]": 1e-4, "u[k-3]": 1e-4 * start["u[k]"], "z[k-2]": 1e-4}},
        {"y": dict.fromkeys(older, 0.1 * small)},
    ]
    return train.finish(train.climb(build({"y": start, "s": force}, phi), steps).model)


def wiener_hammerstein(X: np.ndarray, y: np.ndarray, spec: SearchSpec) -> OurModel:
    """Two filters of third order with a one-sided saturation between them, without dead time.

    Their kinds and corner frequencies are those of the circuit, and are the start: low-pass Chebyshev of
    4.4 kHz and inverse Chebyshev of 5 kHz. x is the voltage between, w what the saturation makes of it: a
    parabola and a few curves tanh((x - centre)/width), whose centres and widths are fitted too. The three
    delays from u to y that this chain of equations has are undone by reading u three samples ahead.
    """
    b1, a1 = cheby1(3, 0.5, 4.4e3, fs=51200)
    b2, a2 = cheby2(3, 40, 5e3, fs=51200)
    gain = b1.sum() / a1.sum()
    model = build(
        {
            "y": lags("y", -a2[1:]) | lags("w", b2),
            "w": {"x[k-2]": 1.0, "x[k-2]^2": -0.05},
            "x": lags("x", -a1[1:]) | lags("u", b1 / gain, first=0),
        }
    )

    def known(model: NARXModel) -> list[Condition]:
        """Units of the inner voltages: static gain one, slope one; and sums are sums."""
        equations = equations_of(model)
        sums = [output for output in model.outputs if output.startswith("p")]
        return [
            ({("x", term): 1.0 for term in equations["x"]}, 1.0),
            ({("w", "x[k-2]"): 1.0}, 1.0),
            *(({(p, f"{p}[k-1]"): 1.0}, 1.0) for p in sums),
        ]

    train = _Trainer(X, y, spec, OurModel(None, advance=3), known=known, skip=400, rounds=1)
    error, best = train.trial(model)
    brief = slice(spec.fit.start, spec.fit.start + 6000)
    for i in range(MAX_CURVES):
        starts = [
            _with_curve(best.model, i, centre, width)
            for centre, width in product((-1.0, -0.3, 0.3, 0.8, 1.3), (0.25, 0.8))
        ]
        # many starts briefly, the best one fully
        tried = [train.fit(one, brief, max_iter=12) for one in starts]
        leader = min(tried, key=lambda one: one.start.sigma)
        trial_error, trial = train.trial(leader.model, max_iter=100)
        if not trial_error < WORTH * error:
            break
        error, best = trial_error, trial
    return train.finish(best.model, max_iter=100)


def _with_curve(model: NARXModel, i: int, centre: float, width: float) -> NARXModel:
    """Add a curve tanh((x - centre)/width) to w."""
    more = {
        "w": {f"t{i}[k-1]": -0.02},
        f"p{i}": {f"p{i}[k-1]": 1.0, "x[k-1]": 1.0 / width, "1": -centre / width},
    }
    return extended(model, more, [SmoothSign(f"p{i}", width=1.0, name=f"t{i}")])


def tanks(X: np.ndarray, y: np.ndarray, spec: SearchSpec) -> OurModel:
    """Two tanks, each emptied by a curve of its level x or y; the upper overflows; the sensor ends at 10 V.

    The curves are polynomials that start at a square root with a time constant of about a minute. Overflow is
    a hinge: what x has above a level (a parameter) is lost fast, partly into the lower tank.
    """
    train = _Trainer(
        X, y, spec, OurModel(None, highest=10.0), rounds=4, known=lambda m: _tanks_known(m, inflow)
    )
    rate = 0.2
    inflow = rate * np.sqrt(y.mean()) / X.mean()
    level = np.linspace(0.2, 10.0, 200)
    trials = []
    for degree in (2, 3):
        curve = np.polynomial.Polynomial.fit(level, rate * np.sqrt(level), degree).convert().coef
        out = {f"[k-1]^{i}" if i > 1 else "[k-1]": c for i, c in enumerate(curve) if i}
        lower = {f"x{power}": c for power, c in out.items()} | {f"y{power}": -c for power, c in out.items()}
        upper = {f"x{power}": -c for power, c in out.items()}
        lower["y[k-1]"] += 1.0
        upper["x[k-1]"] += 1.0
        model = build(
            {"y": lower | {"1": 1e-6}, "x": upper | {"u[k-1]": inflow, "1": -curve[0]}},
        )
        first = np.full((1, 2), y[spec.fit][:10].mean())
        trials.append(train.trial(model, first_state=first, max_iter=150))
        plain = trials[-1][1]
        for top in (8.0, 9.0, 10.0):
            trials.append(train.trial(_with_overflow(plain.model, top), max_iter=150))
    best = min((trial for trial in trials if trial[1] is not None), key=lambda trial: trial[0])[1]
    return train.finish(best.model, max_iter=150)


def _with_overflow(model: NARXModel, top: float) -> NARXModel:
    """Add max(x - top, 0) = (d + |d|)/2, d = x - top, lost by the upper tank, gained in part by the lower."""
    more: Equations = {
        "x": {"a[k-1]": -0.05, "d[k-1]": -0.05},
        "y": {"a[k-1]": 0.01, "d[k-1]": 0.01},
        "p": {"p[k-1]": 1.0, "x[k-1]": 1.0, "1": -top},
    }
    return extended(model, more, [AbsoluteDifference("p", name="a"), Difference("p", name="d")])


def _tanks_known(model: NARXModel, inflow: float) -> list[Condition]:
    """The unit of x; p adds up x - top; each tank's overflow is one hinge."""
    wanted: list[Condition] = [({("x", "u[k-1]"): 1.0}, inflow)]
    if "p" in model.outputs:
        wanted += [({("p", "p[k-1]"): 1.0}, 1.0), ({("p", "x[k-1]"): 1.0}, 1.0)]
        wanted += [({(tank, "a[k-1]"): 1.0, (tank, "d[k-1]"): -1.0}, 0.0) for tank in ("x", "y")]
    return wanted


def emps(X: np.ndarray, y: np.ndarray, spec: SearchSpec) -> OurModel:
    """A drive: force moves a mass, against Coulomb and viscous friction; the position integrates.

    Integration is the constraint y[k-1] + y[k-2] = 1. Decimated, the voltage is the mean over a step. The
    sign of the velocity turns over 1 mm/s: the Coulomb force of a step must not overshoot standstill.
    Candidates are what else friction and drives do: friction that depends on direction, on velocity
    (Stribeck, drag) or on position, and a force that is not proportional to the voltage.

    With the direction alone the model follows each stroke of either record to 0.2 mm, but with some 4 % more
    friction in the test record than in the training record. That difference limits this row: choices that
    look alike in training move it by some millimetres.
    """
    _, best = min((_emps_at(X, y, spec, step) for step in spec.decimations), key=lambda one: one[0])
    return _emps_trainer(X, y, spec, best.decimation).finish(best.model, max_iter=200)


def _emps_trainer(X: np.ndarray, y: np.ndarray, spec: SearchSpec, step: int) -> _Trainer:
    integrates: Condition = ({("y", "y[k-1]"): 1.0, ("y", "y[k-2]"): 1.0}, 1.0)
    frame = OurModel(None, decimation=step, mean_input=step > 1)
    return _Trainer(X, y, spec, frame, head=20 // step, rounds=1, known=lambda model: [integrates])


def _emps_at(X: np.ndarray, y: np.ndarray, spec: SearchSpec, step: int) -> tuple[float, OurModel]:
    """Return the best model at one decimation and its validation error."""
    train = _emps_trainer(X, y, spec, step)
    width = 1e-3 * 1e-3 * step  # 1 mm/s times the step
    phi: list[Phi] = [
        SmoothSign("y", width=width, name="s"),
        SmoothSign("y", width=30 * width, name="r"),
        AbsoluteDifference("y", name="a"),
        Difference("y", name="d"),
    ]
    constraint = "y[k-1] + y[k-2] = 1"
    start = NARXRegressor(
        2, 1, phi=phi[:1], degree=1, n_terms=5, refine=False, origin="zero", constraints=constraint
    ).fit(train.frame.inputs(X)[:, None], y[::step])
    friction = ("a[k-1]", "d[k-1]*a[k-1]", "d[k-1]^3", "r[k-1]")
    at_position = ("y[k-1]*s[k-1]", "y[k-1]^2*s[k-1]", "y[k-1]*a[k-1]", "y[k-1]*d[k-1]")
    candidates = (*friction, *at_position, "u[k-1]^3")
    error, best = train.trial(build(equations_of(start.model_), phi))
    while True:
        tried = [train.trial(extended(best.model, {"y": {term: 1e-9}})) for term in candidates]
        trial_error, trial = min(tried, key=lambda one: one[0])
        if not trial_error < WORTH * error:
            return error, best
        error, best = trial_error, trial


RECIPES = {"emps": emps, "tanks": tanks, "wiener_hammerstein": wiener_hammerstein, "bouc_wen": bouc_wen}


def recipe_for(spec: SearchSpec) -> Callable | None:
    """Return the recipe of the recording that a search is for; None if there is none.

    A method is told the split and nothing else, by which the recording is known.
    """
    for name, recipe in RECIPES.items():
        if replace(RECORDINGS[name]().spec, budget_s=spec.budget_s) == spec:
            return recipe
    return None
