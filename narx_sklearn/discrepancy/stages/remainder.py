"""Is what is left over noise? What follows the motion, comes in bursts or pulsates is none, of any colour."""

from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.stats import norm, rankdata

from narx_sklearn.discrepancy.fitting.acting import port_in_words
from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.fitting.refit import Fit, fit
from narx_sklearn.discrepancy.locate import Tangent, ports_of, tangent
from narx_sklearn.discrepancy.noise import estimate_noise
from narx_sklearn.discrepancy.placed import Port
from narx_sklearn.discrepancy.records.steps import measured_steps
from narx_sklearn.discrepancy.search.bank import INVISIBLE, beside, directions, out_of
from narx_sklearn.discrepancy.search.detect import (
    DRAWS,
    SLOW,
    block_length,
    blocks_of,
    exceeded,
    flipped_maxima,
    strongest_line,
)
from narx_sklearn.discrepancy.search.hypotheses import Hypothesis
from narx_sklearn.discrepancy.simulators.simulator import Run
from narx_sklearn.discrepancy.simulators.structure import Structure
from narx_sklearn.discrepancy.stages.followed import (
    BEFORE,
    SHAPES,
    followed,
    followed_slowly,
    followed_together,
    response,
)
from narx_sklearn.discrepancy.stages.pulse import strongest_pulse
from narx_sklearn.model.units import in_seconds

ROUNDS = 2  # of noise and parameters in turn
CHUNK = 64  # forces answered to at once, so that memory does not grow with their number
COARSE = 3  # half turns of the curves that the residual's size may follow
PINNED = 0.5  # leverage above which a sample was fitted rather than predicted
BURSTS = (4, 16, 64, 256)  # lengths of bursts, samples
FEW_DRAWS = 499  # orders that are tried first
ENOUGH = 25  # of these that do as much: more draws would make no sign of it
FEWEST_BURSTS = 8  # of one length that the record must have room for
LOUD = 4.0  # standard deviations above the mean: stretches that are told
MOST_TOLD = 5  # bursts
MEDIAN = 0.6745  # of the size of a normal variate
MORE_DRAWS = (
    20_000  # of signs, where none of the first does as much: else no sign could speak in a second look
)
HILL = 2  # ordinates of a spectrum to either side that are of one level
NEAR = range(2, 7)  # ordinates from a line: near enough for one level, far enough from its foot
SHARED = 0.5  # of what is left on two outputs, below which it is a disturbance like any
REACH = 20  # samples by which what is left on one output may come before that on another
TO_TRY = {
    "follows": "an effect of your own that depends on it, or one more measured signal as an input",
    "size": "the same input at half and at twice the amplitude: what belongs to the machine changes with it",
    "bursts": "a look at those times, and a record of what else went on then (contacts, supply, blows)",
    "line": "a record with the input at rest: a line that stays comes from outside",
    "pulse": "what turns or is fed at that frequency (gears, pumps, the mains), at another speed of it",
    "together": "one more signal measured inside, and a record at rest: what comes from outside stays",
}


class Sign(NamedTuple):
    """One thing that noise does not do."""

    kind: str  # "follows", "size", "bursts", "line", "pulse" or "together"
    words: str  # a sentence
    p_value: float
    frequencies: tuple[float, ...] = ()  # of a pulse and its images, Hz
    gain: float = 0.0  # by how much the cost would fall without it, noise variances
    port: Port | None = None  # at which what follows a signal acts

    @property
    def to_try(self) -> str:
        """What would tell more."""
        return TO_TRY[self.kind]


class Remainder(NamedTuple):
    """What speaks against noise in what a model leaves over."""

    signs: tuple[Sign, ...]  # one a test

    @property
    def p_value(self) -> float:
        """Chance of the strongest sign where there is only noise; every test pays (Bonferroni)."""
        return min([1.0, *(len(self.signs) * sign.p_value for sign in self.signs)])

    def speaking(self, level: float) -> tuple[Sign, ...]:
        """Return the signs that stand on their own at a level over all tests."""
        return tuple(sign for sign in self.signs if len(self.signs) * sign.p_value <= level)


def look_at_remainder(
    problem: Problem,
    model: Model,
    structure: Structure,
    random_state=None,
    forms: Sequence[Hypothesis] = (),
) -> Remainder:
    """Test whether what a model leaves over can be noise of any stationary colour.

    Noise of whatever colour, made white, (A) follows no function of the motion acting at any port, (B) is as
    large wherever the machine is, (C) comes in no bursts, (D) holds no line, (E) is no wave times a signal
    acting at any port, and (F) comes to every output on its own. The colour is first fitted to the residual
    itself, so that all that a colour can explain, it explains. So is what other ``forms`` of the model's
    laws would do.
    """
    for _ in range(ROUNDS):
        problem = problem.with_noise(estimate_noise(problem.left_over(model), problem.seen))
        found = fit(problem, model)
        model = found.model
    if not (np.isfinite(found.cost) and found.cost > 0):
        return Remainder(())
    rng = np.random.default_rng(random_state)
    found = beside(problem, found, forms)
    slow = found.projector(np.stack([problem.whiten(drift) for drift in drifts_of(problem)], axis=2))
    found = found._replace(jacobian=np.concatenate([found.jacobian, slow], axis=2))
    e = out_of(found.jacobian, found.residual[:, :, None])[:, :, 0]
    leverage = _leverage(found, e)
    scores = _scores(problem, leverage, e)
    run = problem.run(model)
    linear = tangent_along(problem, model, run)
    return Remainder(
        (
            _follows(problem, found, run, linear, e, structure, rng),
            _size_follows(problem, run, scores, structure, rng),
            _in_bursts(problem, scores, e, rng),
            _line(problem, e),
            _pulse(problem, found, run, linear, e, structure, rng),
            _together(problem, found, leverage, e),
        )
    )


def look_for_pulse(problem: Problem, found: Fit, structure: Structure, random_state=None) -> Sign:
    """Test whether what a fit leaves over follows a wave times a signal."""
    run = problem.run(found.model)
    linear = tangent_along(problem, found.model, run)
    e = out_of(found.jacobian, found.residual[:, :, None])[:, :, 0]
    return _pulse(problem, found, run, linear, e, structure, np.random.default_rng(random_state))


def tangent_along(problem: Problem, model: Model, run: Run) -> Tangent:
    """Linearise a model along its run."""
    simulator = problem.simulator.with_effects(model.effects)
    return tangent(simulator, run, problem.u, problem.windows, model.p)


def drifts_of(problem: Problem) -> list[np.ndarray]:
    """Return slow cosines on every output: what drifts with them is left to the noise."""
    n_samples, n_outputs = problem.y.shape
    turns = np.pi * np.arange(n_samples) / n_samples
    return [np.outer(np.cos(m * turns), unit) for unit in np.eye(n_outputs) for m in range(2 * SLOW + 1)]


def _follows(
    problem: Problem, found: Fit, run: Run, linear: Tangent, e: np.ndarray, structure: Structure, rng
) -> Sign:
    """Test the residual against the answers to whatever follows the motion, at every port."""
    simulator = problem.simulator
    n_outputs = problem.y.shape[1]
    length = block_length(e.shape[0], e.shape[1] // n_outputs)
    words, at, products, spreads = [], [], [], []
    for port in ports_of(simulator):
        if port.kind == "state" and structure.kinematic[port.index]:
            continue
        at_output = port.kind == "output"
        where = port_in_words(port, simulator)
        candidates = followed(problem, run, structure, SHAPES, past=int(at_output))
        candidates += followed_together(problem, run, past=int(at_output))
        if port.kind != "state":
            candidates += followed_slowly(problem, run, past=int(at_output))
        candidates = [c for c in candidates if c.is_at_home(port, structure)]
        for begin in range(0, len(candidates), CHUNK):
            chunk = candidates[begin : begin + CHUNK]
            answers = response(problem, linear, port, np.column_stack([c.values for c in chunk]))
            raw = np.stack([problem.whiten(answers[:, :, j]) for j in range(len(chunk))], axis=2)
            columns = out_of(found.jacobian, found.projector(raw))
            size = np.einsum("wtj,wtj->j", columns, columns)
            keep = size > INVISIBLE * np.maximum(np.einsum("wtj,wtj->j", raw, raw), 1e-300)
            products.append(blocks_of(columns[:, :, keep] * e[:, :, None], n_outputs, length))
            spreads.append(spectral_spread(columns[:, :, keep], e, n_outputs))
            words += [f"{c.words}, acting {where}" for c, kept in zip(chunk, keep, strict=True) if kept]
            at += [port] * int(keep.sum())
    p, j, t = _largest(products, spreads, rng)
    if not words:
        return Sign("follows", "", p, gain=t**2)
    return Sign("follows", f"It depends on {words[j]}.", p, gain=t**2, port=at[j])


def _size_follows(problem: Problem, run: Run, scores: np.ndarray, structure: Structure, rng) -> Sign:
    """Test the size of the innovations against the motion."""
    n_outputs = problem.y.shape[1]
    length = block_length(scores.shape[0], scores.shape[1] // n_outputs)
    candidates = followed(problem, run, structure, COARSE, BEFORE, past=1)
    products, spreads, words = [], [], []
    for i, output in enumerate(problem.simulator.outputs):
        z = np.zeros_like(scores)
        z[:, i::n_outputs] = scores[:, i::n_outputs]
        for candidate in candidates:
            column = np.repeat(candidate.values[problem.rows], n_outputs, axis=1)
            column = np.where(z != 0, column - column[z != 0].mean(), 0.0) if z.any() else np.zeros_like(z)
            products.append(blocks_of((column * z)[:, :, None], n_outputs, length))
            spreads.append(spectral_spread(column[:, :, None], z, n_outputs))
            words.append(f"on {output} depends on {candidate.words}")
    p, j, _ = _largest(products, spreads, rng)
    return Sign("size", f"Its size {words[j]}." if words else "", p)


def _largest(products: list[np.ndarray], spreads: list[np.ndarray], rng) -> tuple[float, int, float]:
    """Return the p-value of the largest of many sums, its place and size, by flips of the signs of blocks.

    A sum is measured by the larger of two spreads: that of its blocks, which holds under unequal noise, and
    ``spreads``, which hold under whatever colour the whitening left.
    """
    if not products or not sum(p.shape[1] for p in products):
        return 1.0, 0, 0.0
    by_block, spread = np.hstack(products), np.concatenate(spreads)
    by_block = by_block[np.any(by_block != 0, axis=1)]
    own = np.sqrt(np.einsum("bj,bj->j", by_block, by_block))
    own[own == 0] = np.inf
    t = np.abs(by_block.sum(axis=0)) / np.maximum(own, spread)
    above, draws = 0, 0
    for draws_more in (DRAWS, MORE_DRAWS):
        largest = flipped_maxima(by_block / own, draws_more, rng)
        above += int(np.count_nonzero(largest >= t.max() * (1 - 1e-9)))
        draws += draws_more
        if above:
            break
    return (1.0 + above) / (1.0 + draws), int(np.argmax(t)), float(t.max())


def spectral_spread(columns: np.ndarray, e: np.ndarray, n_outputs: int) -> np.ndarray:
    r"""Return the standard deviation of the sums of columns (W, T, n) times noise e (W, T) of any colour.

    .. math:: \operatorname{Var} \sum_k c_k e_k = \frac{1}{N} \sum_f |C_f|^2 S_f

    with the spectrum S of e from its periodogram, averaged over neighbouring ordinates (Hannan 1963).
    """
    variance = np.zeros(columns.shape[2])
    for i in range(n_outputs):
        r = e[:, i::n_outputs].ravel()
        c = columns[:, i::n_outputs].reshape(r.size, columns.shape[2])
        spectrum = np.abs(np.fft.fft(r)) ** 2 / r.size
        spectrum = uniform_filter1d(spectrum, 2 * HILL + 1, mode="wrap")
        variance += spectrum @ np.abs(np.fft.fft(c, axis=0)) ** 2 / r.size
    return np.sqrt(variance)


def _together(problem: Problem, found: Fit, leverage: np.ndarray, e: np.ndarray) -> Sign:
    """Test whether innovations on two outputs go together: noise of sensors does not, what acts inside does.

    Correlated at any lag, by the larger of the spreads of the products and of their blocks. Every machine
    has some disturbance; a sign is one that makes up most of what is left on both.
    """
    outputs = problem.simulator.outputs
    n_outputs = len(outputs)
    length = block_length(e.shape[0], e.shape[1] // n_outputs)
    counted = np.where(_predicted(problem, leverage), e, 0.0).reshape(e.shape[0], -1, n_outputs)
    left = problem.left_over(found.model)
    fine = np.flatnonzero(~(measured_steps(problem.y) > problem.noise.sigma))
    pairs = list(combinations(fine, 2))
    largest, words = 0.0, ""
    for i, j in pairs:
        if _shared(left[:, :, i], left[:, :, j]) < SHARED:
            continue
        for one, other in ((i, j), (j, i)):
            for lag in range(min(REACH + 1, counted.shape[1])):
                products = counted[:, : counted.shape[1] - lag, one] * counted[:, lag:, other]
                blocks = blocks_of(products[:, :, None], 1, length)
                spread = np.sqrt(max(np.sum(products**2), np.sum(blocks**2)))
                if abs(products.sum()) > largest * spread:
                    largest = abs(products.sum()) / spread
                    words = (
                        f"It goes together on {outputs[i]} and {outputs[j]}: it acts inside, on no sensor."
                    )
    n_tried = len(pairs) * (2 * REACH + 1)
    return Sign("together", words, float(min(1.0, 2 * n_tried * norm.sf(largest))) if words else 1.0)


def _shared(one: np.ndarray, other: np.ndarray) -> float:
    """Return the lesser share of the power of two signals, (W, L), that a filter makes of the other's."""
    shares, length = [], one.shape[1]
    reach = min(REACH, length // 4)  # half of a short window at least is inside
    for target, source in ((one, other), (other, one)):
        inside = slice(reach, length - reach)
        late = [source[:, reach + k : length - reach + k] for k in range(-reach, reach + 1)]
        columns = np.stack([column.ravel() for column in late], axis=1)
        wanted = target[:, inside].ravel()
        rest = wanted - columns @ np.linalg.lstsq(columns, wanted, rcond=None)[0]
        shares.append(1.0 - np.sum(rest**2) / max(np.sum(wanted**2), 1e-300))
    return float(min(shares))


def _predicted(problem: Problem, leverage: np.ndarray) -> np.ndarray:
    """Return the innovations that count, and that the fit has not pinned down."""
    return problem.weighted.reshape(leverage.shape) & (leverage < PINNED)


def _leverage(found: Fit, e: np.ndarray) -> np.ndarray:
    """Return the share of each innovation's variance that the fit has taken, (W, T)."""
    own, basis = found.projector.basis, directions(found.jacobian)
    leverage = np.einsum("wtk,wtk->wt", own, own)
    return leverage + np.einsum("nk,nk->n", basis, basis).reshape(e.shape)


def _scores(problem: Problem, leverage: np.ndarray, e: np.ndarray) -> np.ndarray:
    """Return how large each innovation is among those of its output, (W, T): Savage scores of unit variance.

    Ranks make heavy tails and clipping harmless. Where the fit has pinned the residual down it is brought
    back to size, or left out (zero). So is an output of which a converter's steps hide the noise: what it
    rounds off is larger or smaller with every level.
    """
    counts = _predicted(problem, leverage)
    size = np.abs(e) / np.sqrt(np.where(counts, 1 - leverage, 1.0))
    scores = np.zeros_like(e)
    n_outputs = problem.y.shape[1]
    for i in np.flatnonzero(~(measured_steps(problem.y) > problem.noise.sigma)):
        counted = np.zeros_like(counts)
        counted[:, i::n_outputs] = counts[:, i::n_outputs]
        if counted.any():
            s = -np.log1p(-rankdata(size[counted]) / (counted.sum() + 1))
            scores[counted] = (s - s.mean()) / s.std() if np.ptp(s) > 0 else 0.0
    return scores


def _in_bursts(problem: Problem, scores: np.ndarray, e: np.ndarray, rng) -> Sign:
    """Test whether large innovations come together, against the same ones in any order.

    On each output, and on all at once: what acts inside is felt by several. Of few orders first, and of many
    only where few of those do as much (Besag and Clifford 1991).
    """
    names = [str(output) for output in problem.simulator.outputs]
    scores, e = scores.reshape(-1, len(names)), e.reshape(-1, len(names))
    outputs = [[i] for i in range(len(names))]
    if len(names) > 1:
        outputs.append(list(range(len(names))))
        names.append("all outputs at once")
        counted = np.all(scores != 0, axis=1)
        scores = np.column_stack([scores, np.where(counted, scores.sum(axis=1), 0.0)])
    places = [np.flatnonzero(column) for column in scores.T]
    own = {i: scores[place, i] for i, place in enumerate(places) if _lengths(place)}
    if not own:
        return Sign("bursts", "", 1.0)
    drawn = {i: np.empty((0, len(_lengths(z)))) for i, z in own.items()}
    for draws in (FEW_DRAWS, DRAWS):
        largest, found = np.full(draws, -np.inf), {}
        for i, z in own.items():
            more = [_clustering(rng.permutation(z)) for _ in range(draws - len(drawn[i]))]
            drawn[i] = np.concatenate([drawn[i], more])
            centre, spread = drawn[i].mean(axis=0), drawn[i].std(axis=0)
            largest = np.maximum(largest, ((drawn[i] - centre) / spread).max(axis=1))
            found[i] = float(((_clustering(z) - centre) / spread).max())
        loudest = max(found, key=lambda i: found[i])
        above = np.count_nonzero(largest >= found[loudest])
        if above >= ENOUGH:
            break
    when, gain = _loud(problem, e[places[loudest]][:, outputs[loudest]], places[loudest])
    p = (1.0 + above) / (1.0 + draws)
    return Sign("bursts", f"It comes in bursts on {names[loudest]}{when}.", p, gain=gain)


def _lengths(z: np.ndarray) -> list[int]:
    """Return the lengths of bursts that a series has room for."""
    return [length for length in BURSTS if FEWEST_BURSTS * length <= z.size]


def _clustering(z: np.ndarray) -> np.ndarray:
    """Return the mean square of the sums over blocks, of each length."""
    found = []
    for length in _lengths(z):
        whole = z.size // length * length
        found.append(np.mean(z[:whole].reshape(-1, length).sum(axis=1) ** 2))
    return np.array(found)


def _loud(problem: Problem, e: np.ndarray, place: np.ndarray) -> tuple[str, float]:
    """Return the times of the loudest bursts of innovations e (n, n_outputs) in words, and their excess.

    The excess is that of their squares over ordinary ones. It is counted as costs are, in variances of the
    problem's noise: what comes in bursts has made that larger than what is ordinary.
    """
    length = BURSTS[1]
    typical = np.median(np.abs(e), axis=0) / MEDIAN
    excess = np.convolve(np.sum(e**2 - typical**2, axis=1), np.ones(length), mode="same")
    power = np.sum((e / np.where(typical > 0, typical, np.inf)) ** 2 - 1.0, axis=1)
    spread = np.sqrt(2 * length * e.shape[1])
    means = np.convolve(power, np.ones(length) / spread, mode="same")
    times: list[float] = []
    gain = 0.0
    while len(times) < MOST_TOLD and means.max() > LOUD:
        k = int(np.argmax(means))
        times.append(problem.rows.ravel()[place[k]] * problem.simulator.dt)
        gain += float(excess[k])
        means[max(k - length, 0) : k + length] = 0.0
    return (" round " + ", ".join(in_seconds(t, 4) for t in sorted(times)) if times else ""), gain


def _line(problem: Problem, e: np.ndarray) -> Sign:
    """Test for a line that stands alone; a resonance that something keeps moving is no line, but a hill."""
    driving = np.where(problem.inside[:, :, None], problem.u[problem.rows], 0.0)
    n_outputs = problem.y.shape[1]
    frequency, p, output = strongest_line(e, n_outputs, driving)
    signal = e[:, output::n_outputs].ravel()
    power = np.abs(np.fft.rfft(signal)) ** 2
    at = round(frequency * signal.size)
    beside = [at + sign * d for d in NEAR for sign in (-1, 1) if 0 < at + sign * d < power.size]
    level = max(np.mean(power[beside]), 1e-300)
    alone = power.size * exceeded(power[at] / level, len(beside))  # every ordinate was tried
    hertz = frequency / problem.simulator.dt
    words = f"It holds a line at {hertz:.4g} Hz that the input has not."
    gain = 2.0 * max(power[at] - level, 0.0) / signal.size  # Parseval
    return Sign("line", words, float(min(1.0, max(p, alone))), gain=gain)


def _pulse(
    problem: Problem, found: Fit, run: Run, linear: Tangent, e: np.ndarray, structure: Structure, rng
) -> Sign:
    """Test for a wave times a signal at any port: a parameter that pulsates."""
    pulse = strongest_pulse(problem, found, run, linear, e, structure, rng)
    if pulse is None:
        return Sign("pulse", "", 1.0)
    hertz = tuple(frequency / problem.simulator.dt for frequency in pulse.frequencies)
    where = port_in_words(pulse.port, problem.simulator)
    or_these = " or ".join(f"{f:.4g}" for f in hertz)
    words = f"It goes with {pulse.signal} times a wave of {or_these} Hz, acting {where}."
    return Sign("pulse", words, pulse.p_value, hertz, pulse.gain, pulse.port)
