"""Laws without a name at several ports: which goes first, and what is said where the record cannot tell."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest

from narx_sklearn.discrepancy import ODESimulator
from narx_sklearn.discrepancy.findings import where_names_stand_in
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.placed import PlacedEffect, Port
from narx_sklearn.discrepancy.search.candidate import HARDLY, Candidate
from narx_sklearn.discrepancy.search.confirm import CLEARER
from narx_sklearn.discrepancy.search.places import odd_if_coupled
from narx_sklearn.discrepancy.search.unnamed.one_place import place_hypotheses
from narx_sklearn.discrepancy.simulators.structure import find_structure
from narx_sklearn.discrepancy.stages import diagnosis, unnamed
from narx_sklearn.discrepancy.stages.coloured_search import Searched
from narx_sklearn.discrepancy.stages.followed import Followed
from narx_sklearn.discrepancy.stages.judgement import Judgement
from narx_sklearn.discrepancy.stages.remainder import Sign
from narx_sklearn.discrepancy.stages.told_law import LeftByLaw
from narx_sklearn.discrepancy.stages.unforeseen import Worth
from narx_sklearn.physics.effects import CATALOGUE


def cascade(x, u, p):
    """Two tanks, the upper of which drains into the lower."""
    return p[0] * u[0] - p[1] * x[0], p[1] * x[0] - p[2] * x[1]


def tanks():
    return ODESimulator(
        cascade,
        dt=1.0,
        parameters={"pump": 0.5, "upper outlet": 0.1, "lower outlet": 0.05},
        states=["upper [cm]", "lower [cm]"],
        inputs=["pump [V]"],
        output=[1],
    )


@pytest.fixture(scope="module")
def told():
    simulator, rng = tanks(), np.random.default_rng(0)
    u = np.repeat(rng.uniform(0.0, 5.0, 40), 25)[:, None]
    upper = np.cumsum(rng.normal(size=1000)) + 10.0
    x = np.column_stack([upper, np.cumsum(rng.normal(size=1000)) + 20.0])
    return simulator, find_structure(simulator, x, u), x


def test_a_law_is_odd_that_brings_a_state_into_an_equation_which_has_nothing_of_it(told):
    simulator, structure, x = told
    laws = [odd_if_coupled(h.placed, structure) for h in place_hypotheses(simulator, structure, x)]
    odd = {(str(law.port), law.argument_name): law.odd for law in laws}
    assert odd == {
        ("state:0", "upper"): False,
        ("state:0", "lower"): True,
        ("state:1", "lower"): False,
        ("state:1", "upper"): False,
        ("state:1", "lower - upper"): False,
    }


def test_so_is_one_of_two_signals_if_either_is_new_there(told):
    _, structure, _ = told
    product = PlacedEffect(CATALOGUE["bilinear_input"], Port("state", 0), weights=(1.0, 0.0))
    driven, foreign = (replace(product, second=second) for second in ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0)))
    assert [odd_if_coupled(law, structure).odd for law in (product, driven, foreign)] == [False, False, True]
    at_sensor = PlacedEffect(CATALOGUE["additive_drift"], Port("output", 0))
    assert odd_if_coupled(at_sensor, structure) is at_sensor


def test_what_is_left_is_told_at_an_input_only_if_it_follows_that_input_or_there_is_no_other_place(told):
    _, structure, _ = told
    pump, upper, both = (Followed("", np.zeros(1), of) for of in ((0,), (1,), (0, 1)))
    ports = Port("input", 0), Port("state", 0), Port("state", 1), Port("output", 0)
    at_home = [[each.is_at_home(port, structure) for port in ports] for each in (pump, upper, both)]
    assert at_home == [[True, False, True, True], [False, True, True, True], [False, True, True, True]]
    to_both = structure._replace(inputs=np.ones((2, 1), dtype=bool))
    uneven = structure._replace(varies=np.array([[True], [False]]))
    for other in (to_both, uneven):  # what is added to the input is not what is added to one equation
        assert all(each.is_at_home(port, other) for each in (pump, upper, both) for port in ports)


def test_what_a_body_moves_is_at_home_in_its_equation_though_nothing_holds_it_there_yet():
    axis = ODESimulator(
        lambda x, u, p: (x[1], p[0] * u[0] - p[1] * x[1]),
        dt=0.01,
        parameters={"a": 1.0, "b": 1.0},
        inputs=["drive"],
        states=["position", "speed"],
    )
    x = np.random.default_rng(0).normal(size=(200, 2))
    structure = find_structure(axis, x, x[:, :1])
    assert not structure.states[1, 0]
    detents = [h.placed for h in place_hypotheses(axis, structure, x)]
    assert [odd_if_coupled(law, structure).odd for law in detents] == [False, False]


@dataclass(frozen=True)
class Law:
    """A law at a port, its criterion under the noise of a problem, and the deviance under its own noise."""

    port: Port
    criterion: float
    own: float
    elsewhere: tuple = ()
    price: float = 0.0

    @property
    def fit(self):
        return SimpleNamespace(model=self)

    @property
    def effects(self):
        return (PlacedEffect(CATALOGUE["constant_load"], self.port),)


WHITE = SimpleNamespace(noise=Noise.white(np.ones(1)))
COLOURED = SimpleNamespace(noise=WHITE.noise.with_colour(0, np.array([0.9]), 0.0))


@pytest.mark.parametrize(
    ("problem", "clearer", "leads"),
    [
        (COLOURED, CLEARER - 0.1, "state:1"),
        (COLOURED, CLEARER + 0.1, "output:0"),
        (WHITE, CLEARER + 0.1, "state:1"),  # which holds nothing that another law left
    ],
)
def test_a_law_that_is_clearly_likelier_under_its_own_noise_goes_first(monkeypatch, problem, clearer, leads):
    monkeypatch.setattr(unnamed, "deviance", lambda problem, law: law.own)
    monkeypatch.setattr(unnamed, "converged", lambda problem, law, n_jobs: law)
    motion, sensor = Law(Port("state", 1), 0.0, 500.0), Law(Port("output", 0), 50.0, 500.0 - clearer)
    for laws in ([motion, sensor], [sensor, motion]):
        assert str(unnamed._likeliest(problem, laws, None).port) == leads
    assert unnamed._likeliest(problem, [], None) is None


def test_the_ports_are_told_at_which_a_law_is_hardly_less_likely(monkeypatch):
    monkeypatch.setattr(unnamed, "deviance", lambda problem, law: law.own)
    best = Law(Port("state", 1), 0.0, 0.0)
    others = [
        Law(Port("state", 1), 1.0, 0.0),  # the same port
        Law(Port("input", 0), HARDLY - 0.1, 0.0),
        Law(Port("state", 0), HARDLY + 0.1, 0.0),
        Law(Port("output", 0), 1.0, CLEARER + 0.1),  # clearly less likely under its own noise
        Law(Port("output", 1), 0.5, CLEARER - 0.1),
    ]
    found = unnamed._likeliest(COLOURED, [*others, best], None)
    assert [str(law.port) for law in found.elsewhere] == ["output:1", "input:0"]


def test_names_stand_in_for_a_law_at_the_port_of_what_is_left_in_their_equation(told):
    _, structure, _ = told
    wave = PlacedEffect(CATALOGUE["periodic_disturbance"], Port("state", 0))
    sign = Sign("pulse", "It goes with pump times a wave.", 1e-9, gain=50.0, port=Port("input", 0))

    def where(effects, signs, unforeseen=None):
        return where_names_stand_in(
            SimpleNamespace(
                best=SimpleNamespace(effects=effects),
                against_noise=signs,
                unforeseen=unforeseen,
                structure=structure,
            )
        )

    assert where((wave,), (sign,)) == Port("input", 0)
    assert where((replace(wave, port=Port("state", 1)),), (sign,)) is None  # in another equation
    assert where((replace(wave, port=Port("input", 0)),), (sign,)) is None  # there already
    assert where((wave,), (sign._replace(port=None),)) is None
    assert where((), (sign,)) is None
    assert where((wave,), (sign,), unforeseen=object()) is None


@pytest.mark.parametrize(("signs", "is_told"), [((Sign("size", "", 1e-9),), True), ((), False)])
def test_a_law_that_says_more_than_what_follows_no_signal_is_told_though_it_leaves_most(
    monkeypatch, signs, is_told
):
    law, asked = Law(Port("state", 0), -100.0, -100.0), []
    monkeypatch.setattr(diagnosis, "left_by_law", lambda *given: LeftByLaw(1.0, signs))  # no signs: noise
    monkeypatch.setattr(diagnosis, "look_for_unforeseen", lambda *given: SimpleNamespace(p_value=1e-9))
    monkeypatch.setattr(diagnosis, "beside_laws", lambda problem, laws, *given: Worth(laws, None))
    monkeypatch.setattr(diagnosis, "leave_little", lambda *given: False)
    monkeypatch.setattr(diagnosis, "which_leads", lambda *given: asked.append(given[3].laws))
    monkeypatch.setattr(diagnosis, "fitted_beside", lambda problem, fit, seen, n_jobs: (fit, seen))
    nothing = SimpleNamespace(model=SimpleNamespace(effects=()))
    shapeless = Judgement("unknown", Candidate(nothing, 10), (), law)
    searched = Searched(SimpleNamespace(n_seen=10, simulator=None, noise=None), nothing, [])
    settings = SimpleNamespace(tell=lambda stage: None, n_jobs=None, alpha_nameless=0.0025)
    said, _ = diagnosis._unless_unforeseen(shapeless, 1e-4, searched, None, settings)
    assert asked == [law] * is_told
    assert (said.unforeseen is None) == is_told
    assert (said.best is law) == is_told
    assert said.against_noise == signs


@pytest.mark.parametrize(
    ("colour", "law", "signs", "lengthened", "is_enough"),
    [
        (0.0, True, (), 0, True),
        (0.5, True, (), 0, True),  # 75 % of it is new in each sample
        (0.6, True, (), 0, False),  # 64 %: names may leave less than 70 % of it
        (0.0, False, (), 0, False),  # names, of which others may leave less
        (0.0, True, (Sign("bursts", "", 1e-9),), 0, False),
        (0.0, True, (), 800, False),  # where windows were made long any less is enough
    ],
)
def test_a_law_that_leaves_next_to_noise_is_not_looked_for_again(
    told, colour, law, signs, lengthened, is_enough
):
    friction = PlacedEffect(CATALOGUE["coulomb_friction"], Port("state", 1), (0.0, 1.0), theta=(0.2,))
    found = SimpleNamespace(
        best=SimpleNamespace(effects=(place_hypotheses(*told)[0].placed,) if law else (friction,)),
        noise=Noise((np.array([colour][: colour > 0]),), np.array([0.1])),
        problem=SimpleNamespace(seen=np.ones((1, 100, 1), dtype=bool)),
        lengthened_from=lengthened,
        against_noise=signs,
        unforeseen=None,
    )
    assert diagnosis._leaves_next_to_noise(found) is is_enough
