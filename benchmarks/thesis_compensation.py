"""Compensation beside the thesis: Tables 5.3 and 5.5, other references, disturbances, feedback, speed.

    python benchmarks/thesis_compensation.py [--seeds 10] [--json results.json]

The piezo bench is (5.1), 50 s of PRFS at 1 kHz, reference 40 sin(2 pi t) um. All candidates are those of
rate-independent, symmetric hysteresis: the last output, and products with one first difference of the input.
The valve is a simulated one with friction and dead band, identified from 200 s of PRFS at 0.1 Hz round 3 V.
"""

import argparse
import platform
import shutil
import subprocess
import tempfile
import time
import warnings
from pathlib import Path

import numpy as np
from harness.tables import format_table, save_json
from scipy.optimize import brentq

from narx_sklearn import NARXRegressor
from narx_sklearn.compensation import (
    PID,
    BoucWenCompensator,
    InverseCompensator,
    IsolatedCompensator,
    PrandtlIshlinskiiCompensator,
    RootCompensator,
    c_source,
    simulate_loop,
    smooth_output,
    tune_pid,
)
from narx_sklearn.compensation import _kernels as kernels
from narx_sklearn.datasets import make_pneumatic_valve
from narx_sklearn.exceptions import NarxWarning
from narx_sklearn.metrics import mape, nsavi
from narx_sklearn.model import Difference, DifferenceSign, TermLibrary
from narx_sklearn.physics import PIEZO_BENCH, BoucWenModel, PrandtlIshlinskii
from narx_sklearn.signals import prfs

PERIOD = 1e-3
LIMITS = (-80.0, 80.0)
PHI = (Difference("u", name="phi1"), DifferenceSign("u", name="phi2"))
INVERSE_PHI = (Difference("y", name="phi1"), DifferenceSign("y", name="phi2"))


def rate_independent(output: str, *, newest_is_linear: bool = False):
    """Return the structure of symmetric rate-independent hysteresis (second order in the difference)."""

    def keep(term) -> bool:
        powers = dict(term.cluster)
        difference, sign = powers.pop("phi1", 0), powers.pop("phi2", 0)
        level = sum(powers.values())
        if difference == 0:
            return str(term) == f"{output}[k-1]"
        if newest_is_linear and any(v.lag == 0 for v in term.variables):
            return str(term) == "phi1[k]"
        is_odd = (level + difference + sign) % 2 == 1
        return is_odd and sign <= 1 and (difference == 1 or (difference == 2 and level <= 1)) and level <= 4

    return keep


def compensators(period: float = PERIOD, limits=LIMITS) -> dict:
    """Return the three compensators of the thesis with candidates of degree six, and the two of physics.

    The isolable model is refined by its free run. That was chosen by the free run on the last fifth of the
    records of seeds 100 to 105, after fitting the first four fifths: its error there fell in all six.
    """
    common = {
        "degree": 6,
        "max_terms": 25,
        "fit_intercept": False,
        "origin": "zero",
        "sampling_period": period,
    }
    direct = {"phi": PHI, "delay": 0, "constraints": "y[k-1] = 1"}
    root = NARXRegressor(
        1, [0], phi_lags=[0], structure=rate_independent("y"), refine=False, **direct, **common
    )
    isolated = NARXRegressor(
        1, [0, 1], phi_lags=[0, 1], structure=rate_independent("y", newest_is_linear=True), refine=True,
        **direct, **common,
    )  # fmt: skip
    inverse = NARXRegressor(
        1,
        1,
        phi=INVERSE_PHI,
        structure=rate_independent("u"),
        constraints="u[k-1] = 1",
        refine=False,
        **common,
    )
    return {
        "C_R": RootCompensator(root, limits=limits),
        "C_I": IsolatedCompensator(isolated, limits=limits),
        "C_inverse": InverseCompensator(inverse, lead=1, limits=limits),
        "Prandtl-Ishlinskii": PrandtlIshlinskiiCompensator(
            PrandtlIshlinskii(20, min_slope=1e-3), limits=limits
        ),
        "Bouc-Wen": BoucWenCompensator(limits=limits),
    }


def record(seed: int, *, period: float = PERIOD, plant=PIEZO_BENCH, noise: float = 0.0):
    """Return input and output of one identification experiment; noise is relative, on the input's reading."""
    n_samples = round(50.0 / period)
    u = prfs(n_samples, 1.0, period, amplitudes=80.0, random_state=seed)
    y = plant.run(u)
    read = u + noise * u.std() * np.random.default_rng(seed + 1000).standard_normal(n_samples)
    return read.reshape(-1, 1), y


def track(compensator, reference, plant=PIEZO_BENCH) -> tuple[float, float]:
    """Return MAPE and NSAVI on a plant."""
    m = compensator.predict(reference, m_init=0.0)
    y = plant.run(m)
    return (mape(reference, y) if np.isfinite(y).all() else np.inf), nsavi(reference, m)


def sine(period: float = PERIOD, size: float = 40.0, seconds: float = 5.0) -> np.ndarray:
    """Return the thesis's reference."""
    return size * np.sin(2.0 * np.pi * np.arange(round(seconds / period)) * period)


def table_5_3(seeds: int) -> tuple[str, dict]:
    """Return MAPE and NSAVI over seeds beside the thesis."""
    reference = sine()
    found = {name: [] for name in compensators()}
    terms = {}
    for seed in range(seeds):
        X, y = record(seed)
        for name, compensator in compensators().items():
            compensator.fit(X, y)
            found[name].append(track(compensator, reference))
            terms.setdefault(name, []).append(len(getattr(compensator.model_, "library", ())))
    published = {"C_R": (0.1486, 1.1377), "C_I": (0.1516, 1.1363), "C_inverse": (0.5443, 1.1487)}
    rows = []
    for name, values in found.items():
        errors, efforts = np.array(values).T
        rows.append(
            [name, float(np.median(errors)), float(errors.min()), float(errors.max()),
             float(np.median(efforts)), int(np.median(terms[name])), *published.get(name, ("-", "-"))]
        )  # fmt: skip
    rows.append(["none", mape(reference, PIEZO_BENCH.run(reference)), "-", "-", 1.0, "-", 6.5363, 1.0])
    header = ["compensator", "MAPE median", "least", "worst", "NSAVI", "terms", "thesis MAPE", "NSAVI "]
    return format_table(header, rows), {"table_5_3": found}


def studies() -> tuple[str, dict]:
    """Return MAPE on other references, disturbed data and a changed plant (seed 0)."""
    k = np.arange(5000)
    growing = 40.0 * (0.3 + 0.7 * k / 5000) * np.sin(2 * np.pi * k / 1000)
    several = 20.0 * np.sin(2 * np.pi * k / 1000) + 12.0 * np.sin(2 * np.pi * 0.37 * k / 1000)
    stops = sine()
    stops[3130:] = stops[3130]
    softer = BoucWenModel(A=0.9, beta=0.0088, gamma=0.008, input_gain=1.6, hysteresis_gain=-1.0)
    X, y = record(0)
    noisy, y_noisy = record(0, noise=0.05)
    rows = []
    for name, compensator in compensators().items():
        compensator.fit(X, y)
        row = [name, *(track(compensator, r)[0] for r in (growing, several, stops))]
        m = compensator.predict(stops, m_init=0.0)
        rest = PIEZO_BENCH.run(m)[3200:] - stops[-1]
        row += [float(np.abs(rest).max()), float(np.ptp(m[3200:])), track(compensator, sine(), softer)[0]]
        for reading in (noisy, smooth_output(noisy, 201).reshape(-1, 1)):
            row.append(track(compensators()[name].fit(reading, y_noisy), sine())[0])
        rows.append(row)
    rest = PIEZO_BENCH.run(stops)[3200:] - stops[-1]
    rows.append(
        ["none", *(mape(r, PIEZO_BENCH.run(r)) for r in (growing, several, stops)),
         float(abs(rest).max()), 0.0, mape(sine(), softer.run(sine())), "-", "-"]
    )  # fmt: skip
    header = [
        "compensator",
        "growing",
        "two tones",
        "stops",
        "rest [um]",
        "drift [V]",
        "beta +10 %",
        "5 % input noise",
        "smoothed",
    ]
    return format_table(header, rows), {"studies": rows}


def sampling_times() -> tuple[str, dict]:
    """Return MAPE against the sampling time (Figure 5.10), seed 0."""
    rows = []
    for period in (0.001, 0.002, 0.005, 0.01, 0.02):
        X, y = record(0, period=period)
        row = [period]
        for compensator in compensators(period).values():
            row.append(track(compensator.fit(X, y), sine(period))[0])
        rows.append(row)
    return format_table(["period [s]", *compensators()], rows), {"sampling": rows}


def of_level_difference(lag: int, *, degree: int) -> tuple[list[str], list[str]]:
    """Return terms and constraints of ``phi1 (a + b phi2 d + c d^2)``, d = u - y, up to a degree of 2 or 3.

    They say that nothing changes when command and position, which have one scale, are moved alike.
    """
    u, y, move = f"u[k-{lag}]", "y[k-1]", f"phi1[k-{lag}]"
    turned = [f"{level}*{move}*phi2[k-{lag}]" for level in (u, y)]
    terms, constraints = [move, *turned], [f"{turned[0]} + {turned[1]} = 0"]
    if degree == 3:
        square = [f"{levels}*{move}" for levels in (f"{u}^2", f"{u}*{y}", f"{y}^2")]
        terms += square
        constraints += [f"{square[0]} - {square[2]} = 0", f"{square[1]} + 2*{square[2]} = 0"]
    return terms, constraints


def valve_regressor(read: str, held: str, terms, constraints, lags: int = 1) -> NARXRegressor:
    """Return the estimator of a model that can rest anywhere, with just these terms."""
    library = TermLibrary([f"{held}[k-1]", *terms])
    return NARXRegressor(
        1,
        lags,
        phi=(Difference(read, name="phi1"), DifferenceSign(read, name="phi2")),
        phi_lags=lags,
        degree=3,
        structure=set(library).__contains__,
        n_terms=len(library),
        constraints=[f"{held}[k-1] = 1", *constraints],
        fit_intercept=False,
        origin="zero",
        refine=True,
    )


def valve_compensators() -> dict:
    """Return compensators for the valve: the thesis's three with what is known of any valve, and physics.

    Its output rises with its input, so roots are chosen on that side. In sliding its slope is 1, both being
    read in volts: the isolated law passes errors of its input on by that slope less the newest parameter,
    over it, and with this parameter at 1 they never grow. The output is smoothed over a tenth of the fastest
    period. Terms, smoothing and the choice of roots were settled on records with the seeds 0 and 1.
    """
    terms, constraints = of_level_difference(1, degree=3)
    root = valve_regressor("u", "y", terms, constraints)
    terms, constraints = of_level_difference(2, degree=3)
    isolated = valve_regressor("u", "y", ["phi1[k-1]", *terms], ["phi1[k-1] = 1", *constraints], lags=2)
    inverse = valve_regressor("y", "u", *of_level_difference(1, degree=2))
    manners = {"limits": (1.0, 5.0), "rate_limit": 0.05}
    return {
        "C_R, nearest root": RootCompensator(root, **manners),
        "C_R": RootCompensator(root, branch="rising", **manners),
        "C_I": IsolatedCompensator(isolated, **manners),
        "C_inverse": InverseCompensator(inverse, denoise=101, **manners),
        "Prandtl-Ishlinskii": PrandtlIshlinskiiCompensator(
            PrandtlIshlinskii(30, rest_input=3.0, min_slope=0.05, n_settle=500), limits=(1.0, 5.0)
        ),
        "Bouc-Wen": BoucWenCompensator(limits=(1.0, 5.0)),
    }


def valve(friction: float, u, **options):
    """Return the valve's record at a friction in N, with stiction of 2 % more."""
    return make_pneumatic_valve(u=u, coulomb_friction=friction, breakaway_force=1.02 * friction, **options)


def loop_width(plant) -> float:
    """Return the width of a plant's loop in slow motion, in its input's unit where its slope is 1."""
    up = np.linspace(2.0, 4.0, 50_000)
    y = plant(np.concatenate([up, up[::-1]]))
    return float(np.max(y[:50_000:-1] - y[: 50_000 - 1]))


def table_5_5(seeds: int) -> tuple[str, dict]:
    """Return MAPE and NSAVI on two valves with friction, dead band and noise, over seeds, beside the thesis.

    The first valve has the friction that gives the thesis's error without compensation, the second the
    friction of `make_pneumatic_valve`. The exact inverse at rest moves the input by the loop's width at every
    reversal: no law that tracks to the end can do with less.
    """
    reference = 3.08 + 0.34 * np.sin(0.2 * np.pi * 0.01 * np.arange(6000))
    judged = slice(1000, None)
    published = {"C_R": (3.2636, 1.7321), "C_I": (4.3228, 1.7913), "C_inverse": (2.9166, 1.6140)}

    def plant(friction):
        return lambda u: valve(friction, u).truth.y.to_numpy()

    def judge(m, friction):
        return mape(reference[judged], plant(friction)(m)[judged]), nsavi(reference[judged], m[judged])

    like_thesis = brentq(lambda f: judge(reference, f)[0] - 18.1308, 50.0, 250.0, xtol=0.01)
    rows, numbers = [], {}
    for friction in (like_thesis, 250.0):
        found = {name: [] for name in valve_compensators()}
        for seed in range(10, 10 + seeds):
            u = prfs(20_000, 0.1, 0.01, operating_points=3.0, amplitudes=0.8, random_state=seed)
            data = valve(friction, u, noise=0.01, random_state=seed)
            for name, compensator in valve_compensators().items():
                compensator.fit(data.X.to_numpy(), data.y.to_numpy())
                found[name].append(judge(compensator.predict(reference), friction))
        width = loop_width(plant(friction))
        exact = reference + 0.5 * width * np.sign(np.gradient(reference))
        label = f"{friction:.0f} N"
        for name, values in found.items():
            (error, effort), (worst, most) = np.median(values, axis=0), np.max(values, axis=0)
            rows.append([label, name, error, worst, effort, most, *published.get(name, ("-", "-"))])
        for name, m in (("exact inverse at rest", exact), ("none", reference)):
            error, effort = judge(m, friction)
            rows.append([label, name, error, "-", effort, "-", *((18.1308, 1.0) if m is reference else "--")])
        numbers[label] = found
    header = [
        "friction",
        "compensator",
        "MAPE median",
        "worst",
        "NSAVI median",
        "most",
        "thesis MAPE",
        "NSAVI ",
    ]
    return format_table(header, rows), {"table_5_5": numbers}


def loops() -> tuple[str, dict]:
    """Return what feedback and compensator add, on the piezo bench with noise and drift."""
    period = 2e-3
    X, y = record(0, period=period)
    compensator = compensators(period)["C_R"].fit(X, y)
    reference = sine(period, seconds=3.0)
    disturbance = 4.0 * np.arange(reference.size) / reference.size  # creep: 4 um in 3 s
    setting = {"noise": 0.05, "disturbance": disturbance, "random_state": 0}
    options = {"kind": "pi", "sampling_period": period, "limits": (-20.0, 20.0), **setting}
    alone = tune_pid(PIEZO_BENCH, reference, **options)
    inside = tune_pid(PIEZO_BENCH, reference, compensator=compensator, **options)
    cases = {
        "open loop, nothing": (None, None),
        "compensator": (None, compensator),
        "PI, tuned alone": (alone, None),
        "PI, tuned round the compensator": (inside, compensator),
        "PI tuned alone, with the compensator": (alone, compensator),
    }
    rows = []
    for name, (controller, law) in cases.items():
        run = simulate_loop(PIEZO_BENCH, reference, controller=controller, compensator=law, **setting)
        gains = controller or PID()
        rows.append([name, run.mape, run.nsavi, gains.kp, gains.ki])
    return format_table(["loop", "MAPE", "NSAVI", "kp", "ki [1/s]"], rows), {"loops": rows}


C_TIMER = """
#define _POSIX_C_SOURCE 199309L
#include <stdio.h>
#include <time.h>
LAW
static long now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * 1000000000L + t.tv_nsec;
}
int main(void)
{
    static law_state s;
    double r, sum = 0.0;
    long begin, middle;
    law_reset(&s, 0.0, 0.0);
    while (fread(&r, sizeof r, 1, stdin) == 1) {
        begin = now();
        sum += law_step(&s, r);
        middle = now();
        printf("%ld %ld\\n", middle - begin, now() - middle);
    }
    return sum == 0.5;
}
"""


def quantiles(times) -> list:
    """Return the median, the 99.9 % quantile and the largest."""
    return [float(np.median(times)), float(np.quantile(times, 0.999)), float(np.max(times))]


def c_steps(law, reference) -> np.ndarray:
    """Return microseconds of each step in C, and of the clock alone, shape (n_samples, 2)."""
    with tempfile.TemporaryDirectory() as folder:
        source, program = Path(folder, "law.c"), Path(folder, "law")
        source.write_text(C_TIMER.replace("LAW", c_source(law, "law")), encoding="utf-8")
        subprocess.run(["gcc", "-O2", str(source), "-o", str(program), "-lm"], check=True)
        done = subprocess.run([program], input=reference.tobytes(), capture_output=True, check=True)
    return np.array(done.stdout.split(), dtype=float).reshape(-1, 2) / 1000.0


def python_steps(compensator, reference) -> np.ndarray:
    """Return microseconds of each ``step`` called from Python, and of the clock alone."""
    compensator.reset(0.0, 0.0)
    times = np.empty((reference.size, 2))
    for k, r in enumerate(reference.tolist()):
        begin = time.perf_counter_ns()
        compensator.step(r)
        middle = time.perf_counter_ns()
        times[k] = middle - begin, time.perf_counter_ns() - middle
    return times / 1000.0


def kernel_steps(law, reference, block: int = 20) -> np.ndarray:
    """Return microseconds a step in the compiled loop, one mean for each block of samples."""
    state = law.start(0.0, reference[0])
    known, m = reference.reshape(-1, 1), np.empty(block)
    times = np.empty(reference.size // block)
    for i in range(times.size):
        rows = known[i * block : (i + 1) * block]
        begin = time.perf_counter_ns()
        kernels.run(*law.packed, state.values, rows, m)
        times[i] = (time.perf_counter_ns() - begin) / 1000.0 / block
    return times


def speed(n_samples: int = 1_000_000) -> tuple[str, dict]:
    """Return processor seconds for a million samples, and the times of single steps.

    The clock's own rows are the machine's noise: what the same timer reads where nothing is done.
    """
    X, y = record(0)
    reference = np.tile(sine(seconds=1.0), n_samples // 1000)
    whole, single = [], []
    for name, compensator in compensators().items():
        compensator.fit(X[:20_000], y[:20_000])
        compensator.predict(reference[:10])
        runs = []
        for _ in range(5):
            begin = time.process_time()
            compensator.predict(reference)
            runs.append(time.process_time() - begin)
        whole.append([name, float(np.median(runs)), min(runs), max(runs)])
        called = python_steps(compensator, reference[:50_000])
        single.append(
            [name, "compiled loop", *quantiles(kernel_steps(compensator.law_, reference[:400_000]))]
        )
        single.append([name, "from Python", *quantiles(called[:, 0])])
        if shutil.which("gcc"):
            steps = c_steps(compensator.law_, reference[:200_000])
            single.append([name, "C", *quantiles(steps[:, 0])])
    single.append(["the clock alone", "from Python", *quantiles(called[:, 1])])
    if shutil.which("gcc"):
        single.append(["the clock alone", "C", *quantiles(steps[:, 1])])
    text = format_table(["compensator", "1e6 samples [s]", "least", "most"], whole)
    steps_text = format_table(["compensator", "step", "median [us]", "99.9 %", "worst"], single)
    return f"{text}\n\n{steps_text}", {"speed": whole, "steps": single}


PARTS = {
    "table 5.3": table_5_3,
    "studies": studies,
    "sampling time": sampling_times,
    "table 5.5": table_5_5,
    "closed loop": loops,
    "speed": speed,
}

OVER_SEEDS = ("table 5.3", "table 5.5")


def main(seeds: int, parts, path: str | None) -> None:
    """Print the tables asked for and save the numbers."""
    warnings.simplefilter("ignore", NarxWarning)
    content: dict = {"machine": platform.processor()}
    for name in parts:
        begin = time.perf_counter()
        text, numbers = PARTS[name](seeds) if name in OVER_SEEDS else PARTS[name]()
        content |= numbers
        print(f"{name} ({time.perf_counter() - begin:.0f} s)\n{text}\n", flush=True)
    save_json(path, content)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--parts", nargs="*", default=list(PARTS), choices=list(PARTS))
    parser.add_argument("--json", default=None)
    arguments = parser.parse_args()
    main(arguments.seeds, arguments.parts, arguments.json)
