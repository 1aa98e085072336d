"""Does something act that follows no signal? A load that wanders, blows, a supply that gives way.

Its course is a signal of its own, known by its size and by how long it remembers; names that say no more
beside it stand in for it.
"""

from collections.abc import Iterator
from itertools import product
from typing import NamedTuple

import numpy as np
from joblib import Parallel, delayed
from scipy.stats import chi2, norm

from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.fitting.refit import Fit, all_bounds, fit, fit_states
from narx_sklearn.discrepancy.locate import BesideFit, Course, Entry, Refined
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.placed import Port
from narx_sklearn.discrepancy.search.candidate import Candidate
from narx_sklearn.discrepancy.search.confirm import CLEARER, DRIFTS
from narx_sklearn.discrepancy.search.members import that_run, without
from narx_sklearn.discrepancy.search.unnamed.proportions import line_hypotheses
from narx_sklearn.discrepancy.simulators.structure import Structure
from narx_sklearn.discrepancy.stages.foretold import are_foretelling
from narx_sklearn.discrepancy.stages.remainder import drifts_of, tangent_along
from narx_sklearn.discrepancy.stages.unnamed import UNEXPLAINED

MEMORIES = (2.0, 8.0, 32.0, 128.0, 512.0)  # samples for which a course is remembered
FINALISTS = 3  # of all tried on a part of the record, that are tried on the whole
ROUNDS = 4  # of parameters and course in turn
SHARES = (1.0, 0.5, 0.25, 0.1, 0.03)  # of a step, tried until one is an improvement
NO_STEP = 0.01  # of a standard error, in every parameter
MORE_WANDERING = 2  # values of an output's noise that is white and wanders over those of one colour
N_VALUES = 2  # of a course: its size and its memory
ADDED = "a disturbance that follows no signal"
GAIN = "an input's effect that comes and goes"
FACTOR = "a parameter that wanders"
SENTENCES = {
    ADDED: "Something acts here by itself: what it adds follows neither the inputs nor the motion.",
    GAIN: "What {argument} does comes and goes by itself, as if its gain changed, or it were off at times.",
    FACTOR: "Something in proportion to {argument} comes and goes by itself, as if a parameter changed.",
}
TO_TRY = (
    "what else went on when it acted (its course is in location_.force), as a further measured input; a "
    "record at rest, in which it stays if it comes from outside"
)


class Acting(NamedTuple):
    """Where something unforeseen may act, and the name of what it is in proportion to."""

    entry: Entry
    argument: str = ""  # nothing, where it adds

    @property
    def title(self) -> str:
        """What it is."""
        if not self.argument:
            return ADDED
        return GAIN if self.entry.port.kind == "input" else FACTOR

    @property
    def sentence(self) -> str:
        """The same as a sentence."""
        return SENTENCES[self.title].format(argument=self.argument)


class Unforeseen(NamedTuple):
    """The likeliest thing that follows no signal."""

    acting: Acting
    memory: float  # samples
    deviance: float  # minus twice the log-likelihood with it
    of_noise: float  # the same with noise alone, of one colour or wandering on outputs
    n_tried: int
    errors: np.ndarray  # (n_q,) standard errors beside it of all that was fitted
    noise: Noise  # that is left

    @property
    def wanders(self) -> bool:
        """Whether that noise does, on every output in its own way."""
        return bool(self.noise.average)

    @property
    def p_value(self) -> float:
        """Chance that noise of the sensors does as much; all that was tried pays (Bonferroni)."""
        return min(1.0, self.n_tried * float(chi2.sf(max(self.of_noise - self.deviance, 0.0), N_VALUES)))

    def intervals(self, q: np.ndarray, bounds: np.ndarray, level: float) -> np.ndarray:
        """Return confidence intervals of the parameters q beside it, (n_q, 2), within their bounds."""
        width = norm.ppf(0.5 + level / 2) * np.where(self.errors > 0, self.errors, np.inf)
        return np.clip(np.column_stack([q - width, q + width]), bounds[:, :1], bounds[:, 1:])


class Worth(NamedTuple):
    """Laws, and what acts beside them that follows no signal."""

    laws: Candidate
    seen: Unforeseen | None

    @property
    def criterion(self) -> float:
        """Minus twice the log-likelihood of both, and the price of the laws; infinite where these are all."""
        return np.inf if self.seen is None else self.seen.deviance + self.laws.price


class Likely(NamedTuple):
    """A course at one place, and how likely the record is with it."""

    acting: Acting
    course: Course
    deviance: float


def look_for_unforeseen(
    problem: Problem, model: Model, structure: Structure, n_jobs: int | None = None
) -> Unforeseen | None:
    """Return what follows no signal and is likeliest beside a fitted model; None where nothing can be.

    Held against it is noise, white, of one colour, or wandering on one output or on each in its own way, all
    of which may drift: that is no force. It may act beside noise that wanders, too. What is in proportion to
    a state is so to the machine's, which what is added tells best.
    """
    beside, run = beside_fit(problem, model, may_drift=True), problem.run(model)
    added = [Acting(Entry(port)) for port in ports_inside(structure)]
    if not added:
        return None
    on_sensors = [Acting(Entry(Port("output", i))) for i in range(problem.y.shape[1])]
    plain = likeliest_course(beside, added, n_jobs)
    moved = np.nan_to_num(run.x) + np.nan_to_num(beside.deviations(plain.course, len(problem.y)))
    factors = list(factors_inside(problem, moved, structure))
    found = [plain, *([likeliest_course(beside, factors, n_jobs)] if factors else [])]
    best = min(found, key=lambda likely: likely.deviance)
    of_noise = min(beside.noise_alone, likeliest_course(beside, on_sensors, n_jobs).deviance)
    course = beside.in_wandering_noise(best.course)
    wandering = Likely(best.acting, course, beside.deviance(course))
    price = MORE_WANDERING * len(on_sensors) * np.log(problem.n_seen)  # Schwarz 1978
    acting, course, deviance = wandering if wandering.deviance < best.deviance - price else best
    n_tried = (len(added) + len(factors)) * len(MEMORIES)
    refined = beside.refined(course)
    return Unforeseen(acting, course.memory, deviance, of_noise, n_tried, refined.errors, noise_left(refined))


def likeliest_course(beside: BesideFit, places: list[Acting], n_jobs: int | None = None) -> Likely:
    """Return the likeliest course at any of some places, remembered for any time."""
    tried = list(product(places, MEMORIES))
    courses = Parallel(n_jobs=n_jobs, prefer="threads")(
        delayed(beside.course)(acting.entry, memory) for acting, memory in tried
    )
    order = sorted(range(len(tried)), key=lambda i: -courses[i].size.log_likelihood)
    found = [Likely(tried[i][0], courses[i], beside.deviance(courses[i])) for i in order[:FINALISTS]]
    return min(found, key=lambda likely: likely.deviance)


def beside_fit(problem: Problem, model: Model, *, may_drift: bool = False) -> BesideFit:
    """Return a fitted model as what something unforeseen may be beside of.

    Parameters
    ----------
    may_drift : bool, default=False
        Whether outputs may drift slowly, each on its own: that is noise, and no force.
    """
    run = problem.run(model)
    linear = tangent_along(problem, model, run)
    plain = problem.with_noise(Noise.white(np.ones(problem.y.shape[1])))
    jacobian = fit(plain, model, iterations=0).jacobian
    responses = np.zeros((*problem.y.shape, jacobian.shape[2]))
    by_sample = jacobian.reshape(*problem.seen.shape, jacobian.shape[2])
    responses[problem.rows[problem.inside]] = by_sample[problem.inside]
    drifts = np.stack(drifts_of(problem), axis=2) if may_drift else None
    return BesideFit.of(linear, problem.y - run.y, problem.windows, responses, drifts)


def ports_inside(structure: Structure) -> list[Port]:
    """Return where something may be added: in state equations, and at inputs that enter several.

    What is added to an input that enters one equation is what is added there.
    """
    inputs = [Port("input", int(i)) for i in np.flatnonzero(structure.inputs.sum(axis=0) > 1)]
    return inputs + [Port("state", int(i)) for i in np.flatnonzero(~structure.kinematic)]


def factors_inside(problem: Problem, x: np.ndarray, structure: Structure) -> Iterator[Acting]:
    """Yield where something may act in proportion to an input or to states x, (n_samples, n_states).

    An input's gain counts from zero or from where the input mostly is.
    """
    covered = problem.rows[problem.inside]
    for hypothesis in line_hypotheses(problem.simulator, structure):
        placed = hypothesis.placed
        if placed.port.kind == "output":
            continue
        if placed.port.kind == "input":
            own = problem.u[:, placed.port.index]
            signals = [own, own - np.median(own[covered])]
        else:
            signals = [x @ np.array(placed.weights)]
        onward, share = (placed.onward, placed.share) if placed.reacts else (-1, 0.0)
        for signal in signals:
            if np.abs(signal[covered]).max() > 0:
                yield Acting(Entry(placed.port, signal, onward, share), placed.argument_name)


def fitted_beside(
    problem: Problem, refitted: Fit, unforeseen: Unforeseen, n_jobs: int | None = None
) -> tuple[Fit, Unforeseen]:
    """Fit all parameters of a fitted model beside something unforeseen, which a refit takes into them.

    Generalised least squares, linear about one fit after the other (Aitken 1935), within the bounds, with
    steps as long as they improve it.
    """
    acting = unforeseen.acting
    lower, upper = all_bounds(problem, refitted.model).T

    def acts(beside: BesideFit) -> Course:
        course = likeliest_course(beside, [acting], n_jobs).course
        return beside.in_wandering_noise(course) if unforeseen.wanders else course

    def judged(at: Fit) -> tuple[float, Course, Refined]:
        beside = beside_fit(problem, at.model)
        there = beside.as_it_is()  # a step is linear, and has to be an improvement where it leads
        course = acts(beside)
        return there.deviance(acts(there)), course, beside.refined(course)

    def stepped(share: float) -> Fit:
        q = np.clip(found.model.q + share * refined.move, lower, upper)
        return fit_states(problem, found.model.with_q(q))

    found = refitted
    least, course, refined = judged(found)
    for _ in range(ROUNDS):
        if np.all(np.abs(refined.move) <= NO_STEP * refined.errors):
            break
        for at in map(stepped, SHARES):
            if not np.isfinite(at.cost):  # too long a step may go where the simulation diverges
                continue
            further = judged(at)
            if further[0] < least:
                break
        else:
            break
        found, (least, course, refined) = at, further
    noise = noise_left(refined)
    return found, unforeseen._replace(memory=course.memory, errors=refined.errors, noise=noise)


def noise_left(refined: Refined) -> Noise:
    """Return the noise that is left: white, of one colour, or one that wanders on each output."""
    (rho, coloured, white), wanders = refined.colour, refined.colour.wanders
    # white noise over an autoregression is one with a moving average (Granger and Morris 1976)
    lagged = np.where(wanders, rho * white, 0.0)
    half = 0.5 * (coloured * (1.0 - rho**2) + white * (1.0 + rho**2))
    variance = half + np.sqrt(half**2 - lagged**2)
    colours = tuple(np.array([each]) if each > 0 else np.zeros(0) for each in rho)
    average = tuple(lagged / variance) if wanders.any() else ()
    return Noise(colours, refined.unit * np.sqrt(variance), average)


def which_leads(
    problem: Problem,
    unforeseen: Unforeseen,
    base: Candidate,
    told: Worth,
) -> tuple[Candidate, Unforeseen] | None:
    """Return what is unforeseen, and what goes with it, where it says more than laws that were told.

    It acts beside the laws too. Where they do not pay for themselves then, nothing goes with it. Those that
    are right would: beside a machine that is disturbed they are worth their price as well. Where they are,
    but it says more beside them than they do beside it, they go with it. Else they lead (None), as do laws
    that foretell the other half of the record: next to no noise no law pays beside a course of its own.

    Parameters
    ----------
    unforeseen : Unforeseen
        Found without the laws.
    base : Candidate
        Without the laws.
    told : Worth
        The laws, and what acts beside them.
    """
    laws, beside = told
    if beside is None:
        return None
    of_laws = unforeseen.deviance + base.price - told.criterion
    if of_laws < CLEARER:
        return None if are_foretelling(problem, base.fit.model, laws.fit.model) else (base, unforeseen)
    return (laws, beside) if of_laws < beside.of_noise - beside.deviance else None


def leave_little(problem: Problem, unforeseen: Unforeseen, base: Candidate, told: Candidate) -> bool:
    """Tell whether laws leave next to nothing of what something unforeseen does.

    Where next to no noise shows every disturbance, and when a law acts is known less well, it may not pay
    for itself beside them, though it is most of what is missing. A drift is no law in this: it bends as what
    wanders did on this record, and has to pay for that.

    Parameters
    ----------
    base, told : Candidate
        Without and with the laws.
    """
    if any(effect.effect.code in DRIFTS for effect in told.effects):
        return False
    deviations = [unforeseen.noise.deviation(output) for output in range(problem.y.shape[1])]
    plain = problem.with_noise(Noise.white(np.array(deviations)))
    all_of_it, left = (fit(plain, c.fit.model, iterations=0).cost - plain.n_seen for c in (base, told))
    return left <= UNEXPLAINED * all_of_it


def beside_laws(
    problem: Problem, laws: Candidate, structure: Structure, level: float, n_jobs: int | None = None
) -> Worth:
    """Return laws with what acts beside them that follows no signal, if anything does.

    Parameters
    ----------
    level : float
        Chance of a false alarm that is allowed.
    """
    seen = look_for_unforeseen(problem, laws.fit.model, structure, n_jobs)
    return Worth(laws, None if seen is None or seen.p_value > level else seen)


def that_pay(
    problem: Problem, told: Worth, structure: Structure, level: float, n_jobs: int | None = None
) -> Worth:
    """Return a set without the members that do not pay beside what follows no signal, and that.

    What wanders is no noise of a sensor, and a law that is bent to one course of it says nothing of another.
    Where nothing acts beside the whole set, another test says what is noise.

    Parameters
    ----------
    told : Worth
        The whole set, and what acts beside it.
    level : float
        Chance of a false alarm that is allowed, where something is said to follow no signal.
    """
    best = told
    while best.seen is not None and len(best.laws.effects) > 1:
        fewer = that_run(without(problem, best.laws, [effect]) for effect in best.laws.effects)
        beside = (beside_laws(problem, laws, structure, level, n_jobs) for laws in fewer)
        likelier = min(beside, key=lambda one: one.criterion, default=best)
        if not likelier.criterion < best.criterion:
            break
        best = likelier
    return best
