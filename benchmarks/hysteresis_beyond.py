"""Hysteresis beyond the thesis's bench: dampers, non-local memory, asymmetric loops, magnetic materials.

python benchmarks/hysteresis_beyond.py [--only damper,memory,asymmetry,magnets,nees,bouc_wen] [--out FILE]

All errors are NRMSE of the free run (of the standard deviation of the output) on records that the fit has not
seen, unless a column says otherwise. The recordings are read as by the other benchmarks (NARX_SKLEARN_DATA).
"""

import argparse
import os
import warnings
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pandas as pd
from harness.tables import format_table, save_json
from scipy.optimize import minimize_scalar, nnls

from narx_sklearn import NARXRegressor
from narx_sklearn.datasets import fetch_bh_loops, fetch_mr_damper, make_mr_damper
from narx_sklearn.exceptions import DivergenceWarning
from narx_sklearn.metrics import nrmse
from narx_sklearn.model import (
    Difference,
    DifferenceSign,
    FunctionPhi,
    NARXModel,
    Play,
    SmoothSign,
    Term,
    free_run,
)
from narx_sklearn.physics import PrandtlIshlinskiiOperator, first_order_reversal_curves, play
from narx_sklearn.signals import prfs

#: An actuator of wide plays and next to no direct gain: its minor loops are as fat as its major one.
WIDE_PLAYS = PrandtlIshlinskiiOperator((0.0, 2.3, 3.4, 4.6, 5.9), (0.02, 0.2, 0.4, 0.7, 1.0))
N_PLAYS = 30
PI_PHI = (Difference("u", name="phi1"), DifferenceSign("u", name="phi2"))


def only(terms: Iterable[str]):
    """Return the structure of these terms and no others."""
    kept = {Term.parse(text) for text in terms}
    return lambda term: term in kept


def linear_in(output: str, *signs: str):
    """Return the structure of terms with the output and each sign at most to the first power."""
    return lambda term: all(dict(term.cluster).get(name, 0) <= 1 for name in (output, *signs))


def error(narx: NARXRegressor, X, y) -> float:
    """Return the NRMSE of the free run; infinite where it diverges."""
    y = np.asarray(y).ravel()
    simulated = narx.predict(X, y_init=y)
    return nrmse(y, simulated) if np.isfinite(simulated).all() else np.inf


# -- magneto-rheological damper ------------------------------------------------------------------------------


def damper_models(period: float) -> dict[str, NARXRegressor]:
    """Return the published structures (2.53) and (2.64), and a search over phi regressors of the same kind.

    ``v`` is the voltage, ``d`` the displacement, ``F`` the force. The fractional powers of the speed in
    (2.53) are phi regressors of their own, so that its degree of 11 is one of 3.
    """

    def power(exponent: float, name: str) -> FunctionPhi:
        return FunctionPhi(lambda a, b: np.abs((a - b) / period) ** exponent, ["d[k]", "d[k-1]"], name=name)

    shared = {"refine": True, "fit_intercept": False, "degree": 3, "output_lags": 1}
    sign = DifferenceSign("d", name="phi2")
    powers = (power(0.2, "s1"), power(0.4, "s2"), power(0.6, "s3"), power(2.0, "s10"))
    leva_piroddi = (
        "F[k-1]",
        "s2[k-1]*phi2[k-1]",
        "v[k]*s2[k]*phi2[k]",
        "F[k-1]*s3[k]",
        "s10[k]*phi2[k]",
        "v[k]*s1[k]*phi2[k]",
    )
    speed = FunctionPhi(lambda a, b: (a - b) / period, ["d[k]", "d[k-1]"], name="phi1")
    martins_aguirre = ("F[k-1]", "phi2[k-1]", "phi1[k-1]*v[k-1]", "phi2[k-1]*phi1[k-1]*F[k-1]")
    found: dict[str, NARXRegressor] = {
        "(2.53), 6 terms": NARXRegressor(
            input_lags=[0],
            phi=(*powers, sign),
            phi_lags=[0, 1],
            structure=only(leva_piroddi),
            n_terms=6,
            **shared,
        ),
        "(2.64), 4 terms": NARXRegressor(
            input_lags=[1],
            phi=(speed, sign),
            phi_lags=[1],
            structure=only(martins_aguirre),
            n_terms=4,
            **shared,
        ),
    }
    for width in (1.0, 3.0, 10.0):  # cm/s
        phi = (Difference("d", name="phi1"), SmoothSign("d", width * period, name="phi2"))
        found[f"searched, smooth sign of {width:g} cm/s"] = NARXRegressor(
            input_lags=[0], phi=phi, phi_lags=[0], structure=linear_in("F", "phi2"), n_terms=9, **shared
        )
    return found


def report_damper() -> dict:
    """Identify the published and the searched structures on the phenomenological damper."""
    records = []
    for seed in (0, 1):
        plant = make_mr_damper(random_state=seed)
        records.append((plant.X.set_axis(["v", "d"], axis=1), plant.y.rename("F")))
    train, test = records
    results = {}
    for name, narx in damper_models(1e-3).items():
        narx.fit(*train)
        results[name] = {"terms": len(narx.terms_), "fit": error(narx, *train), "test": error(narx, *test)}
    show("Magneto-rheological damper, phenomenological model (another excitation)", results)
    return results


# -- non-local memory ----------------------------------------------------------------------------------------


def play_narx(u: np.ndarray, n_plays: int = N_PLAYS, **options) -> NARXRegressor:
    """Return a regressor on the input and plays of it, radii equally spaced over half its range."""
    radii = 0.5 * np.ptp(u) * np.arange(1, n_plays) / n_plays
    options = {"degree": 1, "max_terms": n_plays + 1} | options
    return NARXRegressor(
        0, [0], phi=[Play("u", r) for r in radii], phi_lags=[0], fit_intercept=False, refine=False, **options
    )


def reversal_path(u_max: float, n_curves: int = 12, n_inputs: int = 801) -> np.ndarray:
    """Return the input that draws first-order reversal curves."""
    paths: list[np.ndarray] = []

    def note(u: np.ndarray) -> np.ndarray:
        paths.append(u)
        return u

    first_order_reversal_curves(note, -u_max, u_max, n_curves=n_curves, n_inputs=n_inputs)
    return paths[0]


def report_memory() -> dict:
    """Let play-phi and local-memory models follow reversal curves and crossing minor loops."""
    u = prfs(20_000, 1.0, 0.001, amplitudes=10.0, random_state=0)
    y = WIDE_PLAYS.run(u)
    tests = {"reversal curves": reversal_path(9.0)}
    tests["crossing loops"] = prfs(20_000, 1.0, 0.001, amplitudes=9.0, random_state=7)
    models = {f"{N_PLAYS - 1} plays": play_narx(u)}
    for structure in ("hysteresis", "rate_independent"):
        for degree in (3, 5):
            for n_terms in (9, 14):
                models[f"local: {structure}, degree {degree}, {n_terms} terms"] = NARXRegressor(
                    1, [0], phi=PI_PHI, phi_lags=[0], degree=degree, n_terms=n_terms, refine=True,
                    structure=structure, constraints="continuum", fit_intercept=False,
                )  # fmt: skip
    results = {}
    for name, narx in models.items():
        narx.fit(u[:, None], y)
        results[name] = {"terms": len(narx.terms_)}
        results[name] |= {test: error(narx, v[:, None], WIDE_PLAYS.run(v)) for test, v in tests.items()}
    show("Prandtl-Ishlinskii actuator: memory of every reversal, or of the output alone", results)
    return results


def report_asymmetry() -> dict:
    """Bend the same actuator's output, so that loading and unloading are no mirror images."""

    def actuator(u: np.ndarray) -> np.ndarray:
        z = WIDE_PLAYS.run(u)
        return z + 0.08 * z**2

    u = prfs(20_000, 1.0, 0.001, amplitudes=10.0, random_state=0)
    v = prfs(20_000, 1.0, 0.001, amplitudes=9.0, random_state=7)
    models = {
        "plays, degree 1": play_narx(u, 12),
        "plays, degree 2": play_narx(u, 12, degree=2, max_terms=60),
        "local: rate_independent, degree 5": NARXRegressor(
            1, [0], phi=PI_PHI, phi_lags=[0], degree=5, n_terms=14, refine=True, structure="rate_independent",
            constraints="continuum", fit_intercept=False,
        ),
    }  # fmt: skip
    results = {}
    for name, narx in models.items():
        narx.fit(u[:, None], actuator(u))
        results[name] = {
            "terms": len(narx.terms_),
            "reversal curves": error(narx, reversal_path(9.0)[:, None], actuator(reversal_path(9.0))),
            "crossing loops": error(narx, v[:, None], actuator(v)),
        }
    show("Asymmetric loops", results)
    return results


# -- magnetic materials --------------------------------------------------------------------------------------

BH_MATERIALS = ("mnzn_ferrite", "mnzn_hp_ferrite", "m130_27s_steel")
BH_PLAYS = 24


def loops_of(frame: pd.DataFrame) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return field and induction of each loop."""
    return [(g["H [A/m]"].to_numpy(), g["B [T]"].to_numpy()) for _, g in frame.groupby("loop [-]")]


def magnet_model(loops, knee: float) -> NARXModel:
    """Return B as weighted plays of tanh(H / knee), plus H: saturation before the memory.

    Weights are not negative, as magnetic domains follow the field; least squares without that sign fits a
    single loop in many ways and predicts none of the others.
    """
    radii = np.arange(BH_PLAYS) / BH_PLAYS
    blocks = [columns_of(H, knee, radii) for H, _ in loops]
    columns, B = np.vstack(blocks), np.concatenate([b for _, b in loops])
    scale = np.maximum(np.abs(columns).max(axis=0), np.finfo(float).tiny)
    weights = nnls(columns / scale, B)[0] / scale
    names = ["H[k]", "m[k]", *(f"play{i}[k]" for i in range(1, BH_PLAYS))]
    return NARXModel.from_equations(
        {name: w for name, w in zip(names, weights, strict=True) if w},
        outputs=("B",),
        inputs=("H", "m"),
        phi=[Play("m", r, name=f"play{i}") for i, r in enumerate(radii) if i],
    )


def columns_of(H: np.ndarray, knee: float, radii: np.ndarray) -> np.ndarray:
    """Return the regressors on the second time round a closed loop, when its history no longer matters."""
    twice = np.concatenate([H, H])
    return np.column_stack([twice, play(np.tanh(twice / knee), radii)])[H.size :]


def magnet_error(model: NARXModel, loops, knee: float) -> float:
    measured, simulated = [], []
    for H, B in loops:
        twice = np.concatenate([H, H])
        run = free_run(model, np.column_stack([twice, np.tanh(twice / knee)]))
        measured.append(B)
        simulated.append(run.y[H.size :, 0])
    return nrmse(np.concatenate(measured), np.concatenate(simulated))


def report_magnets() -> dict:
    """Fit the inner loops and predict the outer, and the reverse; the knee is chosen by the loops fitted."""
    results = {}
    for material in BH_MATERIALS:
        data = fetch_bh_loops(material)
        inner, outer = loops_of(data.train), loops_of(data.test)
        for name, fitted, predicted in (("inner to outer", inner, outer), ("outer to inner", outer, inner)):
            largest = max(H.max() for H, _ in fitted)

            def misfit(log_knee: float, fitted=fitted) -> float:
                return magnet_error(magnet_model(fitted, np.exp(log_knee)), fitted, np.exp(log_knee))

            grid = np.log(largest * np.geomspace(0.08, 3.0, 30))
            at = int(np.argmin([misfit(x) for x in grid]))
            around = (grid[max(at - 1, 0)], grid[min(at + 1, len(grid) - 1)])
            knee = float(np.exp(minimize_scalar(misfit, bounds=around, method="bounded").x))
            model = magnet_model(fitted, knee)
            results[f"{material}, {name}"] = {
                "terms": model.n_terms,
                "knee [A/m]": knee,
                "fit": magnet_error(model, fitted, knee),
                "test": magnet_error(model, predicted, knee),
            }
    show("Measured B-H loops", results)
    return results


# -- recordings ----------------------------------------------------------------------------------------------


def report_nees() -> dict:
    """Identify the recorded damper; width and size by the last fifth of the training part."""
    data = fetch_mr_damper()

    def record(frame: pd.DataFrame) -> tuple[pd.DataFrame, pd.Series]:
        X = frame[["Y [V]", "V [cm/s]", "D [cm]"]].set_axis(["v", "w", "d"], axis=1)
        return X, frame["F [N]"].rename("F")

    X, y = record(data.train)
    cut = 4 * len(X) // 5

    def candidates():
        for width in (1.0, 3.0, 8.0):
            roll_off = FunctionPhi(lambda w, width=width: np.tanh(w / width), ["w[k]"], name="phi2")
            for n_terms in (9, 15):
                yield (
                    f"tanh(w / {width:g} cm/s), {n_terms} terms",
                    NARXRegressor(
                        1, [0], phi=(roll_off,), phi_lags=[0], degree=3, structure=linear_in("F", "phi2"),
                        n_terms=n_terms, refine=True,
                    ),
                )  # fmt: skip

    judged = []
    for name, narx in candidates():
        narx.fit(X[:cut], y[:cut])
        judged.append((error(narx, X[cut:], y[cut:]), name, narx))
    _, name, narx = min(judged, key=lambda row: row[0])
    published = NARXRegressor(
        1, {"v": [1], "w": [1]}, phi=(DifferenceSign("d", name="phi2"),), phi_lags=[1], degree=3, n_terms=4,
        structure=only(("F[k-1]", "phi2[k-1]", "w[k-1]*v[k-1]", "phi2[k-1]*w[k-1]*F[k-1]")), refine=True,
        fit_intercept=False,
    )  # fmt: skip
    results = {}
    for label, one in ((name, narx), ("(2.64), 4 terms", published)):
        one.fit(X, y)
        tests = {part: error(one, *record(frame)) for part, frame in data.test.items()}
        results[label] = {"terms": len(one.terms_), "fit": error(one, X, y)} | tests
    show("Recorded magneto-rheological damper (NEES)", results)
    return results


def report_bouc_wen() -> dict:
    """Run the gray-box recipe of `real_recordings.py` on the Bouc-Wen benchmark."""
    from real_recordings import job

    found = job({"recording": "bouc_wen", "method": "ours", "budget_s": 150.0})
    results = {"gray box, hidden force": {"terms": len(found["terms"])} | found["rmse"]}
    show("Bouc-Wen benchmark, RMSE in 1e-5 m (published: multisine 1.87)", results)
    return results


def show(title: str, results: dict[str, dict]) -> None:
    """Print one table."""
    columns = list(next(iter(results.values())))
    print(f"\n{title}")
    rows = [[name, *row.values()] for name, row in results.items()]
    print(format_table(["model", *columns], rows), flush=True)


PARTS = {
    "damper": report_damper,
    "memory": report_memory,
    "asymmetry": report_asymmetry,
    "magnets": report_magnets,
    "nees": report_nees,
    "bouc_wen": report_bouc_wen,
}


def main() -> None:
    """Run the parts asked for and save their numbers."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", default=",".join(PARTS), help=f"parts to run, of {', '.join(PARTS)}")
    parser.add_argument("--out", type=Path, help="JSON file for all numbers")
    options = parser.parse_args()
    wanted = options.only.split(",")
    unknown = set(wanted) - PARTS.keys()
    if unknown:
        parser.error(f"unknown parts {sorted(unknown)}; known are {', '.join(PARTS)}")
    beside = Path(__file__).resolve().parents[2] / "shared" / "data"
    if beside.is_dir():
        os.environ.setdefault("NARX_SKLEARN_DATA", str(beside))
    warnings.simplefilter("ignore", DivergenceWarning)  # counted as an infinite error
    results = {part: PARTS[part]() for part in wanted}
    if options.out:
        save_json(options.out, results)


if __name__ == "__main__":
    main()
