"""What else it could be: the likeliest set, and the explanations that these data do not exclude."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from narx_sklearn.discrepancy.fitting.problem import Problem
from narx_sklearn.discrepancy.fitting.refit import fit
from narx_sklearn.discrepancy.placed import PlacedEffect
from narx_sklearn.discrepancy.search.bank import out_of
from narx_sklearn.discrepancy.search.candidate import HARDLY, Candidate, odd
from narx_sklearn.discrepancy.search.detect import block_length, blocks_of
from narx_sklearn.discrepancy.search.unnamed.kinds import CHANGED, LINE

CLEARLY = 2.0  # standard deviations by which a rival must fail to be called worse
ALIKE = 2.0  # difference of the criterion that says nothing
REFINES = 0.005  # of what an effect explains, that one which holds it must add; less excludes none as simple
DEARER = 4.0  # what each further parameter of a rival must take off the cost, in noise variances
ONE_WAY = 0.01  # least eigenvalue of the correlations of columns, below which two of them are one
SAME = 6.0  # squared distance of two runs, in noise variances a further parameter, that makes them one
CERTAIN = 60.0  # difference of the criterion beyond which two explanations are not alike in any noise
SETTLED = 8  # iterations that fit the size of an effect whose shape is given


def likeliest(candidates: list[Candidate], unexplained: float) -> Candidate:
    """Return the best candidate; among those that the criterion cannot tell apart, the most natural one.

    Where the best holds another as a special case, hardly worse, that one is enough, unless only the best is
    at home there; so it is where the best needs more parameters and adds next to nothing to what it explains,
    since forms are idealised and strong effects show it. Else natural is an effect made for the unit of its
    argument (gravity for an angle, where it is at home), if the data tell its parameters apart (gravity at
    one angle is a constant load), then fewer parameters. An outflow of a level goes before the constant one
    that it holds, and of two names for one law the likelier, however many parameters it has. Of two places
    of one effect the one that signals pass first is told.

    Parameters
    ----------
    unexplained : float
        Cost without any effect.
    """
    best = min(candidates, key=lambda c: c.criterion)
    fewer = min((c.fit.cost for c in candidates if len(c.effects) < len(best.effects)), default=unexplained)

    def is_near(c: Candidate) -> bool:
        if not is_special_case(c, best) or (odd(c) and not odd(best)):
            return c.criterion <= best.criterion + ALIKE
        added = c.fit.cost - best.fit.cost
        is_simpler = c.n_values < best.n_values
        common = c.places & best.places
        before = min((o.fit.cost for o in candidates if o.places == common), default=fewer)
        is_enough = is_simpler and added <= REFINES * (before - c.fit.cost)
        return c.criterion <= best.criterion + HARDLY + unpaid(best, c) or is_enough

    near = [c for c in candidates if len(c.effects) == len(best.effects) and is_near(c)]

    def is_given_up(c: Candidate) -> bool:
        return any(_is_enough(special, c) and (at_home(special) or not at_home(c)) for special in near)

    alike = [c for c in near if not is_given_up(c)] or near  # two pairs may hold each other
    if any(c is best for c in alike):
        chosen = min(alike, key=lambda c: (not at_home(c), c.n_values, c.criterion))
    else:  # its special case need not be likelier than what the best alone had left behind
        given_up = [c for c in near if all(c is not other for other in alike)]
        chosen = likeliest([c for c in candidates if all(c is not other for other in given_up)], unexplained)
    better = [c for c in candidates if _is_better_name(c, chosen)]
    return _first_in_turn(min(better, key=lambda c: c.criterion, default=chosen), candidates)


def _first_in_turn(chosen: Candidate, candidates: list[Candidate]) -> Candidate:
    """Return a set with its effects where signals pass first, of all places that data cannot tell apart.

    Linear machines let a delay of the input be one of the sensor, and a sine of the load one of the sensor.
    """

    def turn(c: Candidate) -> int:
        return sum(effect.port.turn for effect in c.effects)

    codes = sorted(effect.effect.code for effect in chosen.effects)
    alike = [
        c
        for c in candidates
        if sorted(effect.effect.code for effect in c.effects) == codes
        and c.criterion <= chosen.criterion + ALIKE
        and c.n_values <= chosen.n_values
        and (odd(chosen) or not odd(c))
        and turn(c) < turn(chosen)
    ]
    return min(alike, key=lambda c: (turn(c), c.criterion), default=chosen)


def _is_enough(special: Candidate, general: Candidate) -> bool:
    """Tell whether a set is a special case of another, and simpler or at the same ports.

    What is no simpler and acts elsewhere is no edge of it.
    """
    ports = [{effect.port for effect in c.effects} for c in (special, general)]
    is_simpler = special.n_values < general.n_values
    return is_special_case(special, general) and (is_simpler or ports[0] == ports[1])


def _is_better_name(other: Candidate, chosen: Candidate) -> bool:
    """Tell whether a set is at home where the chosen is its special case, or is likelier and the same law."""
    if len(other.effects) != len(chosen.effects) or odd(other):
        return False
    rival = declared_rival(chosen, other)
    if rival is not None and is_one_law(chosen, rival):
        return other.criterion < chosen.criterion
    near = other.criterion <= chosen.criterion + ALIKE
    return near and is_special_case(chosen, other) and at_home(other) and not at_home(chosen)


def unpaid(best: Candidate, special: Candidate) -> float:
    """Return the price of the parameters that a set has beyond a simpler one and did not pay for.

    Tangents feel nothing of a fall of friction at no speed at all; what it takes off the cost nevertheless,
    at some stop of the motion, it took by having been fitted.
    """
    beyond = best.n_values - special.n_values
    paid = best.n_parameters - special.n_parameters
    return 2 * np.log(np.log(best.n_samples)) * max(beyond - paid, 0)


def at_home(candidate: Candidate) -> bool:
    """Tell whether an effect of a set was made for its argument's unit, and its parameters are told apart.

    Where the unit tells that it belongs to such machines, it is at home even if they are not.
    """
    return any(
        (effect.effect.argument_units == (effect.argument_unit,) and _told_apart(candidate, own))
        or effect.argument_unit in effect.effect.native_units
        for effect, own in zip(candidate.effects, candidate.fit.model.theirs, strict=True)
    )


def _told_apart(candidate: Candidate, own: slice) -> bool:
    """Tell whether an effect's parameters change the run in ways of their own."""
    n = own.stop - own.start
    J = candidate.fit.jacobian
    others = np.concatenate([J[:, :, : own.start], J[:, :, own.stop :]], axis=2)
    columns = out_of(others, J[:, :, own]).reshape(-1, n)
    length = np.linalg.norm(columns, axis=0)
    if not np.all(length > 0):
        return False
    return bool(np.linalg.eigvalsh(columns.T @ columns / np.outer(length, length))[0] > ONE_WAY)


def declared_rival(best: Candidate, other: Candidate) -> PlacedEffect | None:
    """Return what stands in another's place, if the catalogue calls it a look-alike of what stood there."""
    places = best.places & other.places
    mine = [e for e in best.effects if e.place not in places]
    theirs = [e for e in other.effects if e.place not in places]
    alike = len(mine) == len(theirs) == 1 and theirs[0].effect.code in mine[0].effect.lookalikes
    return theirs[0] if alike else None


def is_one_law(best: Candidate, rival: PlacedEffect) -> bool:
    """Tell whether a rival's law is that of an effect at the same port, under another name."""
    return any(rival.effect.code in e.effect.same_law and rival.port == e.port for e in best.effects)


def is_special_case(special: Candidate, general: Candidate) -> bool:
    """Tell whether what stands in the place of one becomes it at an edge of its parameters."""
    mine = {e.effect.code for e in special.effects} - {e.effect.code for e in general.effects}
    return any(code in e.effect.holds for e in general.effects for code in mine)


def look_alikes(
    problem: Problem,
    best: Candidate,
    others: list[Candidate],
    tolerated: float,
    starts: Mapping[tuple, np.ndarray],
    unexplained: float = 0.0,
) -> list[Candidate]:
    """Return the candidates that are not clearly worse than the best, the best first.

    A rival is clearly worse when its residual goes along with what the best would change in it: the score
    of the best's prediction in the rival's residual (Davidson and MacKinnon 1981), the rival's own
    parameters projected out, with a variance from short blocks.

    The catalogue's forms are idealised. Where that shows, what it declares a look-alike stays unless it fits
    worse than a form may be wrong by; what is the same law under another name stays however its form fits.
    Of what explains a great deal no rival with as few parameters is excluded by next to nothing of it, unless
    noise would not do that and the best leaves less: where the rival's form is wrong no other law fits for
    that. Nor is it excluded by a shape that the data do not feel, unless that takes off its price.
    One that holds the best as a special case is not excluded by its further parameters while it fits as well
    with an ordinary shape, far from that special case, unless only the best is at home: a ripple that came
    to one wave a turn is a weight. If it came to the same run, nothing else keeps it but to be likelier
    nevertheless by more than those parameters take off noise.

    Parameters
    ----------
    tolerated : float
        What a form may leave of the cost.
    starts : mapping from places to ndarray of shape (n_starts, n_theta)
        Ordinary parameter values of the effects, by places at which they always act.
    unexplained : float
        Cost without any effect.
    """
    beside = _Beside(problem, best, tolerated, starts, unexplained)
    return [best, *(other for other in others if beside.stays(other))]


@dataclass(frozen=True)
class _Beside:
    """What the data say of rivals beside the best."""

    problem: Problem
    best: Candidate
    tolerated: float
    starts: Mapping[tuple, np.ndarray]
    unexplained: float

    @property
    def unit(self) -> float:
        """The variance of the noise."""
        return self.best.fit.cost / self.best.n_samples

    def stays(self, other: Candidate) -> bool:
        """Tell whether a rival is not clearly worse."""
        best, unit = self.best, self.unit
        declared = declared_rival(best, other)
        holds = declared if is_special_case(best, other) else None  # the best, as a special case
        extra = max(other.n_values - best.n_values, 0)
        worse = other.fit.cost - best.fit.cost
        apart = float(np.sum((other.fit.residual - best.fit.residual) ** 2))
        if holds and apart < SAME * max(extra, 1) * unit:
            is_likelier = other.criterion < best.criterion and -worse > max(extra, 1) * unit
            kept = is_likelier and not self._is_stranger(other)
        elif self._is_hardly_worse(other, declared) or (extra == 0 and worse <= self._excused()):
            kept = True
        elif other.criterion - best.criterion > CERTAIN or (extra and -worse < DEARER * extra * unit):
            kept = False
        else:
            kept = not self._lacks_the_best(other)
        return kept or (holds is not None and self._fits_with_an_ordinary_shape(other, holds))

    def _is_hardly_worse(self, other: Candidate, declared: PlacedEffect | None) -> bool:
        """Tell whether a rival is nearly as likely, or a look-alike whose form may be wrong by that much."""
        is_as_likely = other.criterion - self.best.criterion <= HARDLY + unpaid(self.best, other)
        if is_as_likely or declared is None:
            return is_as_likely
        return other.fit.cost - self.best.fit.cost <= self.tolerated or is_one_law(self.best, declared)

    def _excused(self) -> float:
        """Return what excludes no rival as simple, of the cost."""
        explained = self.unexplained - self.best.fit.cost
        return min(REFINES * explained, max(CERTAIN * self.unit, self.tolerated))

    def _is_stranger(self, other: Candidate) -> bool:
        return at_home(self.best) and not at_home(other)

    def _fits_with_an_ordinary_shape(self, other: Candidate, effect: PlacedEffect) -> bool:
        as_well = self.best.fit.cost + max(HARDLY * self.unit, self.tolerated)
        if other.fit.cost > as_well or self._is_stranger(other):
            return False
        ordinary = self.starts.get(effect.always().place, np.empty((0, 0)))
        return _least_cost(self.problem, other, effect, ordinary) <= as_well

    def _lacks_the_best(self, other: Candidate) -> bool:
        """Tell whether a rival's residual goes along with what the best would change in it."""
        noise = self.best.fit.residual
        n_outputs = self.problem.y.shape[1]
        length = block_length(noise.shape[0], noise.shape[1] // n_outputs)
        change = out_of(other.fit.jacobian, (other.fit.residual - noise)[:, :, None])
        products = blocks_of(change * noise[:, :, None], n_outputs, length)[:, 0]
        score = float(np.einsum("wt,wt->", change[:, :, 0], other.fit.residual))
        size = np.einsum("wt,wt->", change[:, :, 0], change[:, :, 0]) * self.unit
        return score >= CLEARLY * np.sqrt(max(np.sum(products**2), size))


def _least_cost(problem: Problem, candidate: Candidate, effect: PlacedEffect, starts: np.ndarray) -> float:
    """Return the least cost of a candidate with one effect of ordinary shape, its size alone fitted.

    Where a record begins inside a loop is no matter of its shape, nor is the form in which it is built.
    """
    effects, kind = candidate.effects, effect.effect
    at = next(i for i, e in enumerate(effects) if e.place == effect.place)
    own = candidate.fit.model.theirs[at]
    fitted = [0 if effect.amplitude is None else effect.amplitude]
    fitted += [index for index in (kind.begin, kind.form) if index is not None]
    free = np.ones(candidate.fit.model.q.size, dtype=bool)
    free[own] = False
    free[own.start + np.array(fitted)] = True
    costs = []
    for start in starts:
        theta = np.array(start)
        theta[fitted] = np.array(effects[at].theta)[fitted]
        model = candidate.fit.model._replace(effects=(*effects[:at], effect.at(theta), *effects[at + 1 :]))
        costs.append(fit(problem, model, free=free, iterations=SETTLED).cost)
    return min(costs, default=np.inf)


def is_a_change(unnamed: Candidate, best: Candidate) -> bool:
    """Tell whether a change of the simulator's own parameters is as likely as names, with fewer values."""
    if len(unnamed.effects) > 1:  # a law without a name beside one that has one
        return False
    (change,) = unnamed.effects
    fewer = change.n_theta < sum(effect.n_theta for effect in best.effects)
    return change.effect.code in (LINE, CHANGED) and fewer and unnamed.criterion < best.criterion + HARDLY
