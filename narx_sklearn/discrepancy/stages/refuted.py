"""What speaks against names: what they leave, and what explains as much without them."""

from collections.abc import Callable, Iterable, Sequence
from itertools import chain
from typing import NamedTuple

import numpy as np

from narx_sklearn.discrepancy.fitting.problem import Problem
from narx_sklearn.discrepancy.fitting.refit import Fit
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.search.bank import beside, make_bank
from narx_sklearn.discrepancy.search.candidate import HARDLY, OUTSIDE, Candidate, converged, odd
from narx_sklearn.discrepancy.search.confirm import (
    LOAD,
    OFFSET,
    Trial,
    chances,
    deviance,
    is_all_drift,
    is_of_a_sensor,
)
from narx_sklearn.discrepancy.search.explain import probe
from narx_sklearn.discrepancy.search.harmonics import SINE, frequency_of
from narx_sklearn.discrepancy.search.hypotheses import Hypothesis
from narx_sklearn.discrepancy.search.lookalikes import REFINES, is_a_change
from narx_sklearn.discrepancy.search.ranking import gains
from narx_sklearn.discrepancy.search.unnamed.kinds import is_unnamed
from narx_sklearn.discrepancy.settings import Settings
from narx_sklearn.discrepancy.simulators.structure import Structure
from narx_sklearn.discrepancy.stages.coloured_search import hypotheses_of, kept_near, went_far
from narx_sklearn.discrepancy.stages.forms import FORM
from narx_sklearn.discrepancy.stages.remainder import Sign, look_at_remainder
from narx_sklearn.discrepancy.stages.unnamed import SUSPECT, UNEXPLAINED, curves_along

BENT = 0.01  # share of what could be explained that effects which act together may leave: no more is form
BY_CHANCE = 10.0  # noise variances that the best curve takes off pure noise
AS_LOUD = 1.0  # noise deviations, root mean square: what is louder shows in a plot
BEFORE_DATA = 2 * np.log((1 - OUTSIDE) / OUTSIDE)  # twice the logarithm of the odds of a name, before any
FOLLOWING = ("follows", "pulse")  # kinds of signs that no course in time gives
OUTDONE = 0.5  # share that bursts hold which hold more than all the names explain


class Leftover(NamedTuple):
    """The test of what a named set leaves, and what tells it best."""

    p_value: float
    gain: float  # what that would take, beyond what it takes off pure noise
    of_form: bool = False  # told by a curve without a name, in an equation in which a named effect acts

    def refutes(self, taken_off: float, share: float, alpha: float) -> bool:
        """Tell whether it shows that a form is wrong: it is more than a share of what could be explained."""
        return self.of_form and self.p_value <= alpha and self.gain > share * (taken_off + self.gain)


class LeftByForm(NamedTuple):
    """What names that stand visibly leave of what could be explained; nothing where it may be noise."""

    share: float = 0.0  # of what the names take off, and it would
    deviations: float = 0.0  # root mean square, in those of what is left beside it
    doubt: float = 0.0  # the share over that at which the names would not stand


NOTHING_SEEN = LeftByForm()


def left_by_form(refitted: Fit, best: Candidate, unnamed: Candidate | None, leftover: Leftover) -> LeftByForm:
    """Return what names that stand visibly leave to further curves, or to what has no name.

    What is little beside the names and no louder than the noise is a matter of their form.
    """
    unit = best.fit.cost / best.n_samples
    told = []  # gain, and the share that would refute the names
    if leftover.p_value <= SUSPECT and leftover.gain > 0:
        told.append((leftover.gain, FORM if leftover.of_form else UNEXPLAINED))
    if unnamed is not None and unnamed.criterion < best.criterion - HARDLY:
        told.append((best.fit.cost - unnamed.fit.cost - BY_CHANCE * unit, UNEXPLAINED))
    found = NOTHING_SEEN
    for gain, limit in told:
        if not 0 < gain < best.fit.cost:
            continue
        share = gain / (refitted.cost - best.fit.cost + gain)
        deviations = np.sqrt(gain / (best.fit.cost - gain))
        if share <= BENT and deviations <= AS_LOUD:
            continue
        found = max(found, LeftByForm(share, float(deviations), min(share / limit, 1.0)), key=_doubt)
    return found


def _doubt(left: LeftByForm) -> float:
    return left.doubt


def leftover_of(
    problem: Problem,
    best: Candidate,
    structure: Structure,
    settings: Settings,
    forms: Sequence[Hypothesis] = (),
) -> Leftover:
    """Test what the named set leaves, and return what the best further column or curve would take.

    A drift or an offset of an output does not count: the search held it against noise that drifts. Nor does
    what other ``forms`` of the names would do.
    """
    curves = curves_along(problem, best.fit, structure)
    hypotheses = hypotheses_of(problem, best.fit, structure, settings)
    named = [h for h in hypotheses if not (h.placed.place in best.places or is_of_a_sensor(h.placed))]
    explained = beside(problem, best.fit, forms, settings.n_jobs)
    bank = make_bank(problem, explained, [*named, *curves], settings.n_jobs)
    is_curve = np.array([is_unnamed(bank.hypotheses[h].placed) for h in bank.owner])
    gain = gains(bank).gain
    detection = probe(problem, best.fit, bank, settings.random_state, is_curve | (gain > 0))
    curve_gain, at = 0.0, None
    for h in set(bank.owner[is_curve]):
        columns = np.flatnonzero((bank.owner == h) & bank.useful)
        G, b = bank.gram[np.ix_(columns, columns)], bank.plain[columns]
        taken = float(b @ np.linalg.pinv(G, rcond=1e-9, hermitian=True) @ b)
        if taken > curve_gain:
            curve_gain, at = taken, bank.hypotheses[h].placed.port
    named_gain = float(np.where(is_curve, 0.0, gain).max(initial=0.0))
    by_chance = BY_CHANCE * best.fit.cost / best.n_samples
    of_form = at is not None and any(structure.share_equation(at, e.port) for e in best.effects)
    return Leftover(
        detection.p_value, max(curve_gain, named_gain) - by_chance, of_form and curve_gain > named_gain
    )


def only_stand_in(
    problem: Problem,
    refitted: Fit,
    best: Candidate,
    unnamed: Candidate | None,
    leftover: Leftover,
    structure: Structure,
    settings: Settings,
    own_forms: Callable[[], list[Hypothesis]],
) -> bool:
    """Tell whether effects that act together were bent to a law that is none of them.

    One that has no name is then likelier, and simpler, visibly better or no form of theirs, for it acts
    elsewhere; or they visibly leave something where they act that is no matter of their own forms. What is
    left for one more name may be physics too, unless all are of one kind (sines, of which a series makes
    anything).
    """
    if len(best.effects) < 2:
        return False
    if unnamed is not None and is_likelier(unnamed, best):
        better = best.fit.cost - unnamed.fit.cost
        is_simpler = unnamed.n_values <= best.n_values
        law_at = unnamed.effects[0].port
        acts_there = any(structure.share_equation(effect.port, law_at) for effect in best.effects)
        if is_simpler or not acts_there or better > REFINES * (refitted.cost - unnamed.fit.cost):
            return True
    is_series = len({effect.effect.code for effect in best.effects}) == 1

    def refuted_by(left: Leftover) -> bool:
        shows = left._replace(of_form=left.of_form or is_series)
        return shows.refutes(refitted.cost - best.fit.cost, BENT, settings.alpha)

    if not refuted_by(leftover):
        return False
    forms = own_forms()
    return not forms or refuted_by(leftover_of(problem, best, structure, settings, forms))


def needs_wrong_parameters(
    problem: Problem,
    refitted: Fit,
    best: Candidate,
    unnamed: Candidate | None,
    structure: Structure,
    settings: Settings,
) -> bool:
    """Tell whether names outdo what has no name only with parameters that nobody is so wrong about.

    Two names on one signal make nearly any law of it, with a gain that is many times what it was.
    """
    nominal = problem.simulator.nominal
    if unnamed is None or not went_far(best.fit.model.p, nominal) or went_far(unnamed.fit.model.p, nominal):
        return False
    sober = converged(kept_near(problem), best, settings.n_jobs)
    nothing_left = Leftover(1.0, 0.0)
    return is_refuted(refitted, sober, unnamed, nothing_left, settings.alpha) or only_stand_in(
        problem, refitted, sober, unnamed, nothing_left, structure, settings, list
    )


def is_likelier(unnamed: Candidate, best: Candidate) -> bool:
    """Tell whether what has no name is the likelier explanation, though names were before any data."""
    return unnamed.criterion < best.criterion - HARDLY - BEFORE_DATA


def left_that_is_no_noise(
    problem: Problem,
    refitted: Fit,
    best: Candidate,
    structure: Structure,
    settings: Settings,
    own_forms: Callable[[], list[Hypothesis]],
) -> tuple[Sign, ...]:
    """Return what named effects leave of what noise does not do, where that is much beside them.

    One name may be idealised. Where it takes two and that is not all, nor a matter of their own forms, they
    stand in for something else. Noise may be louder at times; bursts count that hold more than all the names
    explain.
    """
    taken_off = refitted.cost - best.fit.cost
    tolerated = {"bursts": OUTDONE}
    otherwise = BENT if len(best.effects) > 1 else UNEXPLAINED

    def much_left(forms: Sequence[Hypothesis] = ()) -> tuple[Sign, ...]:
        remainder = look_at_remainder(problem, best.fit.model, structure, settings.random_state, forms)
        return tuple(
            sign
            for sign in remainder.speaking(settings.alpha_nameless)
            if sign.gain > tolerated.get(sign.kind, otherwise) * (taken_off + sign.gain)
            or _is_of_a_named_wave(sign, problem, best)
        )

    signs = much_left()
    if not signs or len(best.effects) < 2:
        return signs
    forms = own_forms()
    return much_left(forms) if forms else signs


def _is_of_a_named_wave(sign: Sign, problem: Problem, best: Candidate) -> bool:
    """Tell whether what is left goes with a signal times a wave that is named: then the wave is no own one.

    A wave that something else makes knows nothing of the machine's signals, however little of one is left.
    """
    width = 1.0 / (problem.simulator.dt * len(problem.y))  # of a line, Hz
    waves = [frequency_of(e) / (2 * np.pi) for e in best.effects if e.effect.code == SINE]
    return any(abs(hertz - wave) <= width for hertz in sign.frequencies for wave in waves)


def left_that_follows(
    problem: Problem, best: Candidate, structure: Structure, settings: Settings
) -> tuple[Sign, ...]:
    """Return the signs that what drifts leaves follows a signal, or a wave times one.

    A drift goes where it will, and excuses that course alone: what else is left must be noise, however little
    it is beside the course.
    """
    remainder = look_at_remainder(problem, best.fit.model, structure, settings.random_state)
    return tuple(sign for sign in remainder.speaking(settings.alpha_nameless) if sign.kind in FOLLOWING)


def outdoes_drift(trial: Trial, best: Candidate, law: Candidate | None, alpha: float) -> bool:
    """Tell whether a law of the motion is what seems to drift: likelier, though noise may drift beside both.

    A drift goes where it will, so it follows whatever is slow, as errors of counting that add up. Where the
    motion tells that course, it is no drift. The law has to be no noise that drifts either, by chance.

    Parameters
    ----------
    trial : Trial
        With nothing as its base.
    best : Candidate
        Drifts and offsets of outputs.
    """
    if law is None:
        return False
    drifting, following = (deviance(trial.problem, c.fit.model) + c.price for c in (best, law))
    if not following < drifting - HARDLY - BEFORE_DATA:
        return False
    return chances(trial, [law])[0] <= alpha


def may_be_drift(noise: Noise, best: Candidate, alternatives) -> bool:
    """Tell whether outputs are off by nothing but what may drift, or by noise that does."""
    if not best.effects or not all(is_of_a_sensor(effect) for effect in best.effects):
        return False
    drifts = all(noise.drifts(effect.port.index) for effect in best.effects)
    return drifts or any(is_all_drift(c) for c in (best, *chain.from_iterable(alternatives)))


def say_less_than_they_leave(
    names: Iterable[Candidate], law: Candidate | None, pool: Sequence[Candidate]
) -> bool:
    """Tell whether names do hardly more than a constant, all of them, and leave more to a likelier law.

    Nearly every law holds a constant: what one takes off tells for none of them, so it is not what a name
    explains. A constant itself has no form that might be idealised.
    """
    constant = min((c.fit.cost for c in pool if _is_constant(c)), default=None)
    if constant is None or law is None:
        return False
    return all(
        is_likelier(law, name) and constant - name.fit.cost < name.fit.cost - law.fit.cost for name in names
    )


def _is_constant(candidate: Candidate) -> bool:
    """Tell whether a set is one offset or load that always acts."""
    codes = [effect.effect.code for effect in candidate.effects if not effect.passes]
    return len(candidate.effects) == 1 and codes in ([OFFSET], [LOAD])


def is_refuted(
    refitted: Fit, best: Candidate, unnamed: Candidate | None, leftover: Leftover, alpha: float
) -> bool:
    """Tell whether names are none: they leave too much, or what has no name says more, or as much."""
    taken_off = refitted.cost - best.fit.cost
    level = SUSPECT if len(best.effects) > 1 else alpha
    if leftover.p_value <= level and leftover.gain > UNEXPLAINED * (taken_off + leftover.gain):
        return True
    if leftover.refutes(taken_off, FORM, alpha):
        return True
    if unnamed is None:
        return False
    if is_a_change(unnamed, best):
        return True  # a parameter of the simulator's own has changed
    left = best.fit.cost - unnamed.fit.cost
    if odd(best) and left >= -UNEXPLAINED * taken_off:
        return True  # a name from elsewhere says no more than the curve does
    if unnamed.n_values <= best.n_values and is_likelier(unnamed, best):
        return True  # no form needs to be more exact than a simpler law is
    clearly = unnamed.criterion < best.criterion - HARDLY
    return clearly and left > UNEXPLAINED * (refitted.cost - unnamed.fit.cost)
