"""A record in pieces, on one machine or on many: pieces become small triangles, triangles merge.

Whatever a piece says about 84 candidate terms fits into a triangle of 85 x 85 numbers. Triangles from any
number of pieces merge into the one that the whole record would have given, in any order, so any scheduler
will do: a loop, `partial_fit`, or dask if it is installed (`pip install dask`).
"""

import numpy as np
import pandas as pd

from narx_sklearn import NARXModel, NARXRegressor, TermTransformer, free_run
from narx_sklearn.identification import Factor, search_terms

N_PIECES, N_SAMPLES, MAX_TERMS = 8, 5000, 8
CANDIDATES = {"lags": 3, "degree": 3, "include_constant": True}
PLANT = NARXModel.from_equations(
    "0.5*y[k-1] + 0.3*u[k-1] + 0.1*u[k-1]*u[k-2] - 0.1*y[k-1]^2*u[k-2] + e[k]", inputs=("u", "e")
)


def read_piece(number: int) -> tuple[pd.DataFrame, pd.Series]:
    """Return inputs and outputs of one piece; with your own: a file, or a partition of a dask DataFrame."""
    rng = np.random.default_rng(number)
    X = np.column_stack([rng.uniform(-1, 1, N_SAMPLES), 0.01 * rng.normal(size=N_SAMPLES)])
    return pd.DataFrame(X[:, :1], columns=["u"]), pd.Series(free_run(PLANT, X).y[:, 0], name="y")


def piece_factor(number: int) -> Factor:
    """Compress one piece. This is what runs where the data lie; the result is 58 kB whatever their size."""
    X, y = read_piece(number)
    candidates = TermTransformer(**CANDIDATES).fit_transform(pd.concat([y, X], axis=1))
    known = np.isfinite(candidates).all(axis=1)  # the first samples have no past
    return Factor.of(candidates[known], y.to_numpy()[known, None])


def merged(factors) -> Factor:
    """Merge factors two by two."""
    while len(factors) > 1:
        pairs = [first.merge(second) for first, second in zip(factors[::2], factors[1::2], strict=False)]
        factors = pairs + factors[len(factors) // 2 * 2 :]
    return factors[0]


def main() -> None:
    """Identify three times: by a loop, by dask, and with the estimator piece by piece."""
    total = merged([piece_factor(number) for number in range(N_PIECES)])
    path = search_terms(total, MAX_TERMS)
    support = list(path.supports[path.best_size("ebic")])
    signals = pd.DataFrame(np.zeros((10, 2)), columns=["y", "u"])
    names = TermTransformer(**CANDIDATES).fit(signals).get_feature_names_out()
    print(f"{total.n_samples} samples, {len(names)} candidates, {total.R.nbytes} bytes")
    print("by a loop:       ", sorted(names[support]))

    try:
        import dask
    except ImportError:
        print('by dask:          not installed (pip install "dask")')
    else:
        # dask.compute sends the pieces to whatever cluster the client of the session is connected to
        factors = dask.compute(*(dask.delayed(piece_factor)(number) for number in range(N_PIECES)))
        there = search_terms(merged(list(factors)), MAX_TERMS)
        print("by dask:         ", sorted(names[list(there.supports[there.best_size("ebic")])]))

    narx = NARXRegressor(3, 3, degree=3, refine=False)
    for number in range(N_PIECES):
        narx.partial_fit(*read_piece(number))
    print("by partial_fit:  ", narx.terms_)
    print(narx.model_)


if __name__ == "__main__":
    import argparse
    from pathlib import Path

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(), help="not used: there is nothing to draw")
    parser.parse_args()
    main()
