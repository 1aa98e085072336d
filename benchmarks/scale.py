"""Identification on a cluster: time and memory from a million samples on, strong scaling, a plan for more.

A third-order system is simulated partition by partition where it is read, so that no disk limits the size;
each pass of a fit simulates it again. 84 candidate terms; the true model has four.

    python benchmarks/scale.py --samples 1e6 1e7 1e8
    python benchmarks/scale.py --samples 1e7 --workers 1 2 1 2
    python benchmarks/scale.py --plan --seconds-per-sample 1.5e-6
"""

import argparse
import json
import math
import os
import time
from pathlib import Path

import numpy as np

PARTITION = 1_000_000  # samples; 16 MB
PASSES = 4  # survey, factor, count of usable samples, stretches for the covariance
MERGED_TOGETHER = 8  # as the merges are
TAIL = 100  # samples after which the system has forgotten its state (0.5^100)
LAGS, DEGREE, N_TERMS = 3, 3, 84
TRUTH = {"y[k-1]": 0.5, "u[k-1]": 0.3, "u[k-1]*u[k-2]": 0.1, "y[k-1]^2*u[k-2]": -0.1}


def drive(seed: tuple[int, int], n_samples: int) -> np.ndarray:
    """Return input and noise of a stretch."""
    rng = np.random.default_rng(seed)
    return np.column_stack([rng.uniform(-1, 1, n_samples), 0.01 * rng.standard_normal(n_samples)])


def simulate(partition: int, n_samples: int) -> np.ndarray:
    """Return input and output of a partition, which goes on where the one before ends.

    The end of every partition has a seed of its own, so that the next one can make it again.
    """
    from narx_sklearn import NARXModel, free_run

    equation = " + ".join(f"{value}*{term}" for term, value in TRUTH.items()) + " + e[k]"
    model = NARXModel.from_equations(equation.replace("+ -", "- "), inputs=("u", "e"))
    pieces = [drive((partition, 0), n_samples - TAIL), drive((partition, 1), TAIL)]
    if partition:
        pieces.insert(0, drive((partition - 1, 1), TAIL))
    together = np.vstack(pieces)
    y = free_run(model, together, y_init=np.zeros((2, 1))).y
    return np.column_stack([together[:, 0], y[:, 0]])[-n_samples:]


def record(n_samples: int):
    """Return the record as a lazy array of input and output."""
    import dask
    import dask.array as da

    make = dask.delayed(simulate, pure=True)
    n_parts = max(n_samples // PARTITION, 1)
    size = n_samples // n_parts
    return da.concatenate([da.from_delayed(make(i, size), (size, 2), float) for i in range(n_parts)])


def memory_mb(line: str) -> float:
    """Return a line of this process's memory report in megabytes."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return int(next(text for text in lines if text.startswith(line)).split()[1]) / 1024


def measure(n_samples: int, n_workers: int) -> dict:
    """Identify a record on a cluster of its own; return what it took."""
    from distributed import Client, LocalCluster

    from narx_sklearn import NARXRegressor

    settings = {"output_lags": LAGS, "input_lags": LAGS, "degree": DEGREE, "refine": False}
    cluster = LocalCluster(
        n_workers=n_workers, threads_per_worker=1, processes=True, dashboard_address=":0", memory_limit=0
    )
    with cluster, Client(cluster) as client:
        first = record(200_000 * n_workers)
        for _ in range(2):  # every worker has loaded its kernels
            NARXRegressor(**settings).fit(first[:, :1], first[:, 1])
        before = max(client.run(memory_mb, "VmRSS").values())
        data = record(n_samples)
        started, used = time.perf_counter(), sum(client.run(time.process_time).values())
        narx = NARXRegressor(**settings).fit(data[:, :1], data[:, 1])
        seconds = time.perf_counter() - started
        used = sum(client.run(time.process_time).values()) - used
        peak = max(client.run(memory_mb, "VmHWM").values())
    error = max(
        abs(value - TRUTH.get(term, math.inf)) for term, value in zip(narx.terms_, narx.coef_, strict=True)
    )
    return {
        "samples": data.shape[0],
        "workers": n_workers,
        "seconds": round(seconds, 2),
        "microseconds a sample": round(1e6 * seconds / data.shape[0], 3),
        "worker cpu microseconds a sample": round(1e6 * used / data.shape[0], 3),
        "worker memory before MB": round(before),
        "worker peak memory MB": round(peak),
        "terms": narx.terms_,
        "largest parameter error": float(f"{error:.2g}"),
        "load average": round(os.getloadavg()[0], 1),
    }


def plan(n_workers: int, n_samples: float, partition: float, seconds_per_sample: float, n_terms: int) -> dict:
    """Return what a fit on many workers costs: compression in parallel, a tree of merges, one search.

    A factor is (M + 1)^2 doubles; merging two is a QR of 2 (M + 1) rows. What stays serial is one scheduler,
    which hands out a task in a millisecond or so, the top of the tree, and the search. So scaling ends where
    a worker finishes its tasks faster than the scheduler can hand them to all of them: at
    (seconds a task) / (seconds to hand one out) workers. Larger partitions move that bound, up to the
    memory of a worker.
    """
    width, flops, network = n_terms + 1, 5e9, 1e9  # operations a second in small QR; bytes a second of a link
    hand_out = 1.5e-3  # seconds a task: scheduler and client
    n_parts = math.ceil(n_samples / partition)
    factor_bytes = 8 * width**2
    depth = math.ceil(math.log(max(n_parts, 2), MERGED_TOGETHER))
    merge = 10 / 3 * width**3 / flops + factor_bytes / network
    compute = math.ceil(n_parts / n_workers) * partition * seconds_per_sample
    tree = merge * (n_parts / n_workers + MERGED_TOGETHER * depth)
    scheduler = PASSES * n_parts * (1 + 1 / (MERGED_TOGETHER - 1)) * hand_out
    total = (
        max(compute + tree, scheduler) + 1.0
    )  # workers and scheduler work side by side; a second of search
    return {
        "workers": n_workers,
        "samples": n_samples,
        "terms": n_terms,
        "samples a partition": partition,
        "partition MB": round(16 * partition / 1e6),
        "factor MB": round(factor_bytes / 1e6, 3),
        "bytes moved": float(f"{n_parts * (factor_bytes + PASSES * LAGS * 16):.2g}"),
        "merge depth": depth,
        "compute s": round(compute, 1),
        "tree s": round(tree, 2),
        "scheduler s": round(scheduler, 1),
        "total s": round(total, 1),
        "efficiency": round(n_samples * seconds_per_sample / n_workers / total, 2),
        "scales to workers": round(partition * seconds_per_sample / PASSES / hand_out),
    }


def main() -> None:
    """Run every size on every number of workers, or print the plan."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=float, nargs="+", default=[1e6, 1e7])
    parser.add_argument("--workers", type=int, nargs="+", default=[1])
    parser.add_argument("--plan", action="store_true", help="compute instead of measuring")
    parser.add_argument("--seconds-per-sample", type=float, default=1.5e-6, help="of one worker, all passes")
    arguments = parser.parse_args()
    if arguments.plan:
        for n_terms, partition in ((84, 1e6), (84, 1e7), (1771, 1e6)):
            slower = (n_terms / N_TERMS) ** 2  # operations a sample of the compression
            for n_workers in (1, 100, 1000, 10_000):
                cost = plan(n_workers, 1e12, partition, arguments.seconds_per_sample * slower, n_terms)
                print(json.dumps(cost), flush=True)
        return
    for n_samples in arguments.samples:
        for n_workers in arguments.workers:
            print(json.dumps(measure(int(n_samples), n_workers)), flush=True)


if __name__ == "__main__":
    main()
