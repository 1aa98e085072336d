"""Identification of a record on disk: peak memory and time against the number of samples.

A third-order system is simulated block by block into memory-mapped files, then identified from them with 84
candidate terms, every size in a process of its own.

    python benchmarks/out_of_core.py --samples 1e6 1e7 1e8
"""

import argparse
import json
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import numpy as np

BLOCK = 1_000_000


def write_record(folder: Path, n_samples: int) -> None:
    """Simulate y[k] = 0.5 y[k-1] + 0.3 u[k-1] + 0.1 u[k-1] u[k-2] - 0.1 y[k-1]^2 u[k-2] + e[k]."""
    from narx_sklearn import NARXModel, free_run

    model = NARXModel.from_equations(
        "0.5*y[k-1] + 0.3*u[k-1] + 0.1*u[k-1]*u[k-2] - 0.1*y[k-1]^2*u[k-2] + e[k]", inputs=("u", "e")
    )
    rng = np.random.default_rng(0)
    u = np.lib.format.open_memmap(folder / "u.npy", "w+", np.float64, (n_samples, 1))
    y = np.lib.format.open_memmap(folder / "y.npy", "w+", np.float64, (n_samples,))
    last, history = np.zeros((2, 2)), np.zeros((2, 1))
    for begin in range(0, n_samples, BLOCK):
        n = min(BLOCK, n_samples - begin)
        X = np.column_stack([rng.uniform(-1, 1, n), 0.01 * rng.normal(size=n)])
        run = free_run(model, np.vstack([last, X]), y_init=history).y[2:]
        u[begin : begin + n, 0], y[begin : begin + n] = X[:, 0], run[:, 0]
        last, history = X[-2:], run[-2:]
    u.flush()
    y.flush()


def identify(folder: Path) -> dict:
    """Identify the record in ``folder``; return what it took."""
    from narx_sklearn import NARXRegressor

    u = np.load(folder / "u.npy", mmap_mode="r")
    y = np.load(folder / "y.npy", mmap_mode="r")
    NARXRegressor(3, 3, degree=3, refine=False).fit(u[:5000], y[:5000])  # compiled kernels are loaded
    started = time.perf_counter()
    with PeakMemory() as memory:
        narx = NARXRegressor(3, 3, degree=3, refine=False).fit(u, y)
    return {
        "samples": len(u),
        "seconds": round(time.perf_counter() - started, 2),
        "memory before MB": round(memory.before),
        "peak memory MB": round(memory.mb),
        "terms": narx.terms_,
        "parameters": narx.coef_.tolist(),
    }


class PeakMemory:
    """Peak of the process's own memory, the pages of mapped files left out, sampled while it is open."""

    def __enter__(self):
        self.mb, self.before, self._open = 0.0, own_mb(), True
        self._sampler = threading.Thread(target=self._sample, daemon=True)
        self._sampler.start()
        return self

    def _sample(self):
        while self._open:
            self.mb = max(self.mb, own_mb())
            time.sleep(0.01)

    def __exit__(self, *error):
        self._open = False
        self._sampler.join()


def own_mb() -> float:
    """Return the memory of this process that is not pages of mapped files."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return int(next(line for line in lines if line.startswith("RssAnon")).split()[1]) / 1024


def main() -> None:
    """Run every size, print a line for each."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=float, nargs="+", default=[1e6, 1e7])
    parser.add_argument("--folder", type=Path, help="where the record lies: identify it, and print JSON")
    arguments = parser.parse_args()
    if arguments.folder:
        print(json.dumps(identify(arguments.folder)))
        return
    for n_samples in arguments.samples:
        with tempfile.TemporaryDirectory() as name:
            write_record(Path(name), int(n_samples))
            child = subprocess.run(
                [sys.executable, __file__, "--folder", name], capture_output=True, text=True, check=True
            )
            print(child.stdout, end="", flush=True)


if __name__ == "__main__":
    main()
