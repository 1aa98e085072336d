"""Selecting 15 terms from lagged data, and the free run of nine terms: time and peak memory, side by side.

python benchmarks/selection_speed.py [--sizes 1e4x84,1e5x455] [--methods "ours;fastcan: eta"] [--out x.json]

Building the regressor matrix is part of the job; imports, making the data and two warm-ups (300 samples of
10 candidates, 2000 of 455) are not. The free run is the median of three calls after a warm-up. Every run is a
fresh process with the same number of threads, and the methods take turns, so that a drift of the machine
meets all alike. Medians and ratios are of processor time, which a busy machine changes least; wall time
stands beside it.
"""

import argparse
import time
from statistics import median

import methods
import numpy as np
from harness.measure import peak_memory_mb, reset_peak_memory, run_fresh
from harness.polynomial import PlainModel
from harness.tables import format_table, save_json
from harness.truth import MIXED

METHODS = ("ours", "fastcan: h", "fastcan: eta", "fastcan: lazy", "sysidentpy")
RUNNERS = {"ours": 1_000_000, "fastcan": 100_000, "sysidentpy": 100_000}  # samples of the free run
LAGS = {84: 3, 455: 6, 1771: 10}  # lags of u and of y that give so many candidates at degree 3
DEGREE = 3
N_TERMS = 15
FREE_RUNS = 3  # calls in one process, of which the median counts


def make_signals(n_samples: int) -> tuple[np.ndarray, np.ndarray]:
    """Return a white input and the response of a smooth nonlinear system with a little noise.

    Blocks of 1000 samples, each from rest, are simulated side by side, so that no compiler is needed.
    """
    rng = np.random.default_rng(0)
    n_blocks = -(-n_samples // 1000)
    u, e = rng.uniform(-1, 1, (1000, n_blocks)), 0.02 * rng.normal(size=(1000, n_blocks))
    y = np.zeros_like(u)
    for k in range(3, 1000):
        linear = 0.6 * y[k - 1] - 0.2 * y[k - 3] + 0.5 * u[k - 1] + 0.3 * u[k - 2]
        products = 0.1 * y[k - 1] * u[k - 2] - 0.02 * y[k - 2] ** 3 + 0.25 * u[k - 1] ** 2 * u[k - 2]
        y[k] = linear + products + e[k]
    return u.T.ravel()[:n_samples].copy(), y.T.ravel()[:n_samples].copy()


def select_job(task: dict) -> dict:
    """Select the terms once (runs in a process of its own)."""
    select = methods.find("SELECTORS", task["method"])
    u, y = make_signals(task["n_samples"])
    select(u[:300], y[:300], 1, DEGREE, 3)
    select(*make_signals(2000), LAGS[455], DEGREE, 3)
    reset_peak_memory()
    held_mb = peak_memory_mb()
    wall, processor = time.perf_counter(), time.process_time()
    terms = select(u, y, LAGS[task["n_candidates"]], DEGREE, N_TERMS)
    wall, processor = time.perf_counter() - wall, time.process_time() - processor
    return {"wall_s": wall, "cpu_s": processor, "held_mb": held_mb, "terms": terms}


def free_run_job(task: dict) -> dict:
    """Simulate the nine-term system once (runs in a process of its own)."""
    terms, theta = list(MIXED), np.array(list(MIXED.values()))
    run = methods.find("SIMULATORS", task["method"])(terms, theta)
    u = np.random.default_rng(0).uniform(-1, 1, task["n_samples"])
    y_init = np.zeros(3)
    expected = PlainModel(terms, theta).predict(u[:500], y_init)
    difference = float(np.abs(run(u[:500], y_init) - expected).max())  # the warm-up is also a check
    walls, processors = [], []
    for _ in range(FREE_RUNS):
        wall, processor = time.perf_counter(), time.process_time()
        run(u, y_init)
        walls.append(time.perf_counter() - wall)
        processors.append(time.process_time() - processor)
    return {"wall_s": median(walls), "cpu_s": median(processors), "difference": difference}


def _selection(options: argparse.Namespace) -> tuple[dict, list[list]]:
    results: dict[str, list[dict]] = {}
    rows = []
    for size in options.sizes.split(","):
        n_samples, n_candidates = (int(float(number)) for number in size.split("x"))
        big = n_samples * n_candidates > 5e7
        names = options.methods.split(";")
        for _ in range(1 if big else options.repeats):
            for name in names:
                done = results.setdefault(f"{size} | {name}", [])
                if done and "failed" in done[-1]:
                    continue
                task = {"method": name, "n_samples": n_samples, "n_candidates": n_candidates}
                done.append(run_fresh("selection_speed:select_job", task, **_limits(options)))
                print(size, name, {k: v for k, v in done[-1].items() if k != "terms"}, flush=True)
        good = {name: results[f"{size} | {name}"] for name in names}
        good = {name: runs for name, runs in good.items() if "failed" not in runs[-1]}
        seconds = {name: median(run["cpu_s"] for run in runs) for name, runs in good.items()}
        best_peer = min((s for name, s in seconds.items() if name != "ours"), default=None)
        for name in names:
            if name not in good:
                failure = results[f"{size} | {name}"][-1]["failed"]
                rows.append([n_samples, n_candidates, name, failure, *["-"] * 4])
                continue
            runs = good[name]
            rows.append(
                [
                    n_samples,
                    n_candidates,
                    name,
                    seconds[name],
                    median(run["wall_s"] for run in runs),
                    round(median(run["peak_mb"] for run in runs)),
                    round(median(run["peak_mb"] - run["held_mb"] for run in runs)),
                    seconds[name] / best_peer if best_peer else "-",
                ]
            )
    return results, rows


def _free_runs(options: argparse.Namespace) -> tuple[dict, list[list]]:
    results: dict[str, list[dict]] = {}
    names = [name for name in RUNNERS if any(name in method for method in options.methods.split(";"))]
    for _ in range(options.repeats):
        for name in names:
            task = {"method": name, "n_samples": RUNNERS[name]}
            answer = run_fresh("selection_speed:free_run_job", task, **_limits(options))
            results.setdefault(name, []).append(answer)
    rows = []
    for name, runs in results.items():
        if "failed" in runs[-1]:
            rows.append([name, RUNNERS[name], runs[-1]["failed"], "-"])
            continue
        step_us = 1e6 * median(run["cpu_s"] for run in runs) / RUNNERS[name]
        rows.append([name, RUNNERS[name], step_us, max(run["difference"] for run in runs)])
    return results, rows


def _limits(options: argparse.Namespace) -> dict:
    return {"threads": options.threads, "limit_s": options.limit, "memory_gb": options.memory_gb}


def main() -> None:
    """Measure and print both tables."""
    sizes = ",".join(f"{n}x{m}" for m in LAGS for n in ("1e4", "1e5", "1e6"))
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sizes", default=sizes)
    parser.add_argument("--methods", default=";".join(METHODS), help="separated by semicolons")
    parser.add_argument("--repeats", type=int, default=5, help="one run above 5e7 matrix cells")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--limit", type=float, default=900.0, help="processor seconds of one run")
    parser.add_argument("--memory-gb", type=float, default=20.0, help="address space of one run")
    parser.add_argument("--skip-free-run", action="store_true")
    parser.add_argument("--out", help="write the raw results to this JSON file")
    options = parser.parse_args()

    content: dict = {"threads": options.threads, "limit_s": options.limit, "memory_gb": options.memory_gb}
    if not options.skip_free_run:
        content["free_run"], rows = _free_runs(options)
        print(format_table(("free run by", "samples", "us a step (s a million)", "difference"), rows), "\n")
        save_json(options.out, content)
    content["selection"], rows = _selection(options)
    save_json(options.out, content)
    header = ("N", "M", "selection by", "cpu s", "wall s", "peak MB", "MB above data", "x best peer")
    print(format_table(header, rows))


if __name__ == "__main__":
    main()
