"""Known nine-term systems found again: exact structure, wrong terms, and free-run error beside the oracle's.

python benchmarks/recovery.py [--scenarios "no noise;output noise"] [--methods "oracle;ours"] [--seeds 20]
"""

import argparse
import time
from statistics import median

import methods
import numpy as np
from harness.candidates import LibrarySpec
from harness.measure import run_fresh
from harness.polynomial import term_text
from harness.tables import format_table, save_json
from harness.truth import SCENARIOS, make_record

METHODS = (
    "oracle",
    "ours",
    "sysidentpy: FROLS aic",
    "sysidentpy: FROLS bic",
    "sysidentpy: FROLS bic, ELS",
    "sysidentpy: OSF, told size",
    "fastcan: h, bic",
    "fastcan: eta, bic",
    "fastcan: beam 5, bic",
    "fastcan: refine 1, bic",
    "fastcan: eta, told size",
    "fastcan: refine all, told size",
    "fastcan: eta, told size, free-run fit",
    "pysindy: STLSQ bic",
    "pysindy: SSR bic",
)
EXACT_NRMSE = 1e-9  # an oracle at rounding: a ratio to it says nothing
SEPARABLE_T = 6.0  # the oracle's smallest t value above which every true term stands clear of the noise


def job(task: dict) -> dict:
    """Let one method find one scenario's system in several records (runs in a process of its own)."""
    scenario = SCENARIOS[task["scenario"]]
    fit = methods.find("RECOVERERS", task["method"])
    spec = LibrarySpec(
        true_terms=tuple(scenario.system),
        noise_on_output=scenario.output_noise > 0,
        standardise=scenario.unit != (1.0, 1.0),
    )
    true = {term_text(term) for term in spec.true_terms} - {"1"}
    runs = []
    for seed in range(task["seeds"]):
        record = make_record(scenario, seed)
        started = time.process_time()
        model = fit(record.u, record.y, spec)
        seconds = time.process_time() - started
        found = set(model.terms) - {"1"}  # the constant is not scored: fastcan always has one
        n_init = max(spec.output_lags)
        with np.errstate(all="ignore"):
            run = model.predict(record.u_test, record.y_test[:n_init])
            error = np.sqrt(np.mean((run[n_init:] - record.y_test[n_init:]) ** 2)) / record.y_test.std()
        runs.append(
            {
                "missing": len(true - found),
                "spurious": len(found - true),
                "nrmse": float(error) if np.isfinite(error) else None,
                "seconds": seconds,
                "smallest_t": getattr(model, "smallest_t", None),
                "terms": sorted(model.terms),
            }
        )
    return {"runs": runs}


def _rows(scenario: str, answers: dict[str, dict]) -> list[list]:
    oracle = answers.get("oracle", {}).get("runs")
    rows = []
    for method, answer in answers.items():
        if "failed" in answer:
            rows.append([scenario, method, answer["failed"], *["-"] * 6])
        else:
            rows.append([scenario, method, *_figures(answer["runs"], oracle)])
    if oracle is not None:
        clear = sum(run["smallest_t"] > SEPARABLE_T for run in oracle)
        print(f"{scenario}: separable in {clear}/{len(oracle)} (smallest |t| > {SEPARABLE_T:g})", flush=True)
    return rows


def _figures(runs: list[dict], oracle: list[dict] | None) -> list:
    errors = [np.inf if run["nrmse"] is None else run["nrmse"] for run in runs]
    ratios = []
    if oracle is not None and oracle[0]["nrmse"] > EXACT_NRMSE:
        ratios = [error / best["nrmse"] for error, best in zip(errors, oracle, strict=True)]
    exact = [run["missing"] + run["spurious"] == 0 for run in runs]
    return [
        f"{sum(exact)}/{len(runs)}",
        sum(run["missing"] for run in runs) / len(runs),
        sum(run["spurious"] for run in runs) / len(runs),
        100 * median(errors),
        100 * max(errors),
        median(ratios) if ratios else "-",
        median(run["seconds"] for run in runs),
    ]


def main() -> None:
    """Run every method in every scenario and print one table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenarios", default=";".join(SCENARIOS), help="separated by semicolons")
    parser.add_argument("--methods", default=";".join(METHODS), help="separated by semicolons")
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument(
        "--limit", type=float, default=3600.0, help="processor seconds of a method in a scenario"
    )
    parser.add_argument("--out", help="write the raw results to this JSON file")
    options = parser.parse_args()

    results: dict[str, dict] = {}
    rows = []
    names = options.methods.split(";")
    limits = {"threads": options.threads, "limit_s": options.limit, "memory_gb": 8.0}
    for scenario in options.scenarios.split(";"):
        answers = {}
        for method in names:
            task = {"scenario": scenario, "method": method, "seeds": options.seeds}
            answers[method] = run_fresh("recovery:job", task, **limits)
            print(f"{scenario}: {method}: {answers[method].get('failed', 'done')}", flush=True)
            results[f"{scenario} | {method}"] = answers[method]
            save_json(options.out, {"results": results})
        rows += _rows(scenario, answers)
    header = (
        "scenario",
        "method",
        "exact",
        "missing",
        "spurious",
        "NRMSE %",
        "worst %",
        "x oracle",
        "cpu s",
    )
    print(format_table(header, rows))


if __name__ == "__main__":
    main()
