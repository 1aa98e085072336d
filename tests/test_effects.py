"""The catalogue of effects: fields, laws of its forces and transforms, starting values, registration."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import least_squares
from scipy.signal import lfilter, lsim

from narx_sklearn.discrepancy import ODESimulator
from narx_sklearn.discrepancy.placed import PlacedEffect, Port
from narx_sklearn.discrepancy.simulators.addresses import FORCE
from narx_sklearn.discrepancy.simulators.simulator import Windows
from narx_sklearn.model.phi import Phi
from narx_sklearn.model.units import tidy_unit
from narx_sklearn.physics import play
from narx_sklearn.physics.effects import (
    BUILT_IN,
    CATALOGUE,
    Effect,
    EffectParameter,
    Setting,
    held_runs,
    list_effects,
    no_start,
    register_effect,
    unregister_effect,
)
from narx_sklearn.physics.effects._clearance import _plays_run, _stiction_run
from narx_sklearn.physics.effects._dynamics import (
    _along_parabolas,
    _average_run,
    _following_run,
    weights_along_line,
)
from narx_sklearn.physics.effects._effect import ARGUMENTS, MAX_MEMORY, MAX_PARAMETERS
from narx_sklearn.physics.effects._hysteresis import (
    N_PLAYS,
    REACH,
    _bouc_wen_run,
    _creep_run,
    _weighted_plays_run,
)
from narx_sklearn.physics.effects._limits import _rate_limit_run
from narx_sklearn.physics.effects._registry import _check_fields, _check_trial
from narx_sklearn.physics.effects._starts import lines_in_time

# which effect acts where: the table of the catalogue's specification
PLACES = {
    "viscous_damping": "state",
    "coulomb_friction": "state",
    "asymmetric_friction": "state",
    "stribeck_friction": "state",
    "presliding_friction": "state",
    "load_friction": "state",
    "valve_stiction": "input",
    "backlash": "input state",
    "dead_zone": "input",
    "input_saturation": "input",
    "rate_limit": "input",
    "asymmetric_rate_limit": "input",
    "input_polynomial": "input",
    "bouc_wen_hysteresis": "input state",
    "prandtl_ishlinskii": "input state",
    "creep": "state output",
    "linear_stiffness": "state",
    "cubic_stiffness": "state",
    "quadratic_stiffness": "state",
    "bilinear_stiffness": "state",
    "clearance": "state",
    "quadratic_drag": "state",
    "gravity": "state",
    "cogging": "state",
    "bilinear_input": "state",
    "root_outflow": "state",
    "overflow": "state",
    "spill": "state",
    "constant_load": "state",
    "delay": "input output",
    "lag": "input output",
    "gain_drift": "input state",
    "temperature_gain": "input state",
    "additive_drift": "state output",
    "sensor_bias": "output",
    "sensor_clip": "output",
    "quantisation": "output",
    "stuck_sensor": "output",
    "periodic_disturbance": "state output",
    "extra_mode": "state output",
    "coupling": "state",
    "quadratic_coupling": "state",
    "cross_sensitivity": "output",
    "mixed_reading": "output",
    "scale_error": "input output",
    "input_offset": "input",
}
ALL = [CATALOGUE[code] for code in sorted(BUILT_IN)]
FORCES = [effect for effect in ALL if effect.force is not None]
TRANSFORMS = [effect for effect in ALL if effect.transform is not None]
DT = 0.01
ALONE = {"argument": 4.0, "second": np.nan}  # nothing in particular stands in its place


def _size(signal):
    return np.sqrt(np.mean(signal**2))


def by_code(effect):
    return effect.code


def setting_of(argument, *, dt=DT, own=None, second=None, residual=None, first=(0,)):
    """Return a setting in which the argument is as given, and acts on a load of its own kind."""
    argument = np.asarray(argument, dtype=float)
    rate = np.gradient(argument, dt)
    return Setting(
        argument,
        rate,
        argument if own is None else own,
        second,
        np.arange(argument.size) * dt,
        dt,
        np.array(first),
        residual,
    )


def wideband(n=1200, seed=0):
    """Return a smooth signal of several sines that moves both ways."""
    rng = np.random.default_rng(seed)
    t = np.arange(n) * DT
    return sum(np.sin(w * t + p) for w, p in zip(rng.uniform(1, 12, 5), rng.uniform(0, 6, 5), strict=True))


@pytest.fixture(scope="module")
def ordinary():
    """A state's setting in which every effect can act."""
    x = wideband() + 0.3
    return setting_of(x, own=-4.0 * x + wideband(seed=1), second=2.0 + wideband(seed=2), first=(0, 700))


@pytest.fixture(scope="module")
def level():
    """A setting of a level, which never falls below zero."""
    return setting_of(np.abs(wideband()) + 0.1, own=wideband(seed=1))


def starts_of(effect, ordinary, level):
    starts = effect.starts(ordinary)
    starts = starts if len(starts) else effect.starts(level)
    assert len(starts)
    return starts


def force_of(
    effect, theta, argument=0.0, *, rate=0.0, own=0.0, second=0.0, time=0.0, step=DT, z=None, pure=False
):
    """Return force and dz."""
    padded = np.zeros(MAX_PARAMETERS + 1)
    padded[: len(theta)] = theta
    dz = np.full(MAX_MEMORY, np.nan)
    z = np.zeros(MAX_MEMORY) if z is None else z
    function = effect.force.py_func if pure else effect.force
    value = function(
        float(argument), float(rate), float(own), float(second), float(time), float(step), z, padded, dz
    )
    return value, dz[: effect.n_memory]


def transformed(code, signal, theta, *, second=None, first=(0,), dt=DT):
    signal = np.asarray(signal, dtype=float)
    return CATALOGUE[code].transform(signal, second, dt, np.asarray(theta, dtype=float), np.array(first))


class TestEntries:
    def test_every_effect_of_the_table_acts_where_it_says(self):
        assert {e.code: " ".join(e.ports) for e in ALL} == PLACES

    @pytest.mark.parametrize("effect", ALL, ids=by_code)
    def test_an_entry_is_complete(self, effect):
        for text in (effect.title, effect.sentence, effect.equation, effect.separate_by, effect.source):
            assert text.strip()
        assert effect.sentence.endswith(".")
        assert any(character.isdigit() for character in effect.source)  # a year
        assert effect.argument in ARGUMENTS
        assert 1 <= len(effect.parameters) <= MAX_PARAMETERS
        assert 0 <= effect.n_memory <= MAX_MEMORY
        assert effect.memoryless == (effect.n_memory == 0)
        assert (effect.phi is not None) or effect.narx_terms
        for parameter in effect.parameters:
            units = {"port": "m/s^2", "arg": "m/s", "second": "V/A"}
            in_brackets = {name: f"({unit})" for name, unit in units.items()}
            if "^n" not in parameter.unit:  # no whole power: it is told as it came
                told, meant = (tidy_unit(parameter.unit.format(**u)) for u in (units, in_brackets))
                assert told == meant
            assert parameter.lower < parameter.upper
            assert parameter.name in effect.equation

    def test_look_alikes_are_mutual(self):
        for effect in ALL:
            assert effect.lookalikes
            assert effect.code not in effect.lookalikes
            for other in effect.lookalikes:
                assert effect.code in CATALOGUE[other].lookalikes

    @pytest.mark.parametrize("effect", ALL, ids=by_code)
    def test_starting_values_are_few_finite_and_physical(self, effect, ordinary, level):
        starts = starts_of(effect, ordinary, level)
        # thresholds, wave numbers, frequencies, stops: valleys side by side
        most = {"valve_stiction": 24, "cogging": 60, "extra_mode": 20, "clearance": 10, "rate_limit": 9}
        most["asymmetric_rate_limit"] = 10
        assert 1 <= len(starts) <= most.get(effect.code, 8)
        assert starts.shape[1] == len(effect.parameters)
        for parameter, column in zip(effect.parameters, starts.T, strict=True):
            assert np.all(np.isfinite(column))
            assert np.all((column >= parameter.lower) & (column <= parameter.upper))

    @pytest.mark.parametrize("effect", ALL, ids=by_code)
    def test_nothing_starts_on_a_signal_at_rest(self, effect):
        rest = setting_of(np.full(300, 0.7), second=np.full(300, 2.0))
        assert effect.starts(rest).size == 0

    @pytest.mark.parametrize("effect", ALL, ids=by_code)
    def test_its_phi_regressors_run(self, effect, ordinary, level):
        if effect.phi is None:
            return
        theta = starts_of(effect, ordinary, level)[0]
        for phi in effect.phi(theta, "y", DT):
            assert isinstance(phi, Phi)
            assert phi.signal == "y"
            assert np.all(np.isfinite(phi.run(ordinary.argument)))
            assert pickle.loads(pickle.dumps(phi)).describe() == phi.describe()

    def test_an_effect_pickles_by_its_code(self):
        for effect in ALL:
            assert pickle.loads(pickle.dumps(effect)) is effect

    def test_a_changed_copy_pickles_with_its_content(self):
        for effect in ALL:
            mine = replace(effect, title="Mine")
            again = pickle.loads(pickle.dumps(mine))
            assert again.title == "Mine"
            assert again.phi is effect.phi

    def test_phi_regressors_ignore_the_share_that_goes_on(self):
        (phi,) = CATALOGUE["overflow"].phi((2.0, 0.5), "h", DT)
        assert phi.run(np.array([1.0, 3.0, 2.5])).tolist() == [0.0, 1.0, 0.0]


class TestForces:
    @pytest.mark.parametrize("effect", FORCES, ids=by_code)
    def test_compiled_and_python_forms_agree(self, effect, ordinary, level):
        rng = np.random.default_rng(3)
        for theta in starts_of(effect, ordinary, level):
            for _ in range(5):
                argument, rate, own, second, time = rng.normal(size=5) * [1, 3, 3, 1, 1]
                z = rng.normal(size=MAX_MEMORY) * 0.1
                now = {"rate": rate, "own": own, "second": second, "time": abs(time), "z": z}
                fast, dz_fast = force_of(effect, theta, argument, **now)
                slow, dz_slow = force_of(effect, theta, argument, **now, pure=True)
                np.testing.assert_allclose(fast, slow, rtol=1e-12, atol=1e-300)
                np.testing.assert_allclose(dz_fast, dz_slow, rtol=1e-12, atol=1e-300)

    @pytest.mark.parametrize("effect", FORCES, ids=by_code)
    def test_a_force_is_finite_for_extreme_arguments(self, effect, ordinary, level):
        extremes = [0.0, -0.0, 1e-300, -1e-300, 1.0, -1.0, 1e15, -1e15, 1e60, -1e60]
        for theta in starts_of(effect, ordinary, level)[:2]:
            for argument in extremes:
                for rate in (0.0, 1e60, -1e60):
                    for own in (0.0, 1e60, -1e60):
                        value, dz = force_of(
                            effect, theta, argument, rate=rate, own=own, second=1e30, time=1e9, step=1e-6
                        )
                        assert np.isfinite(value)
                        assert np.all(np.isfinite(dz))

    @pytest.mark.parametrize("effect", [e for e in FORCES if e.amplitude is not None], ids=by_code)
    def test_a_force_is_linear_in_its_amplitude(self, effect, ordinary, level):
        theta = starts_of(effect, ordinary, level)[0]
        z = np.full(MAX_MEMORY, 0.02)
        now = {"argument": 0.8, "rate": 0.5, "own": 0.4, "second": 0.3, "time": 2.0, "step": 1e-3, "z": z}
        whole, _ = force_of(effect, theta, **now)
        half = theta.copy()
        half[effect.amplitude] *= 0.5
        assert whole != 0
        np.testing.assert_allclose(force_of(effect, half, **now)[0], 0.5 * whole, rtol=1e-12)

    @pytest.mark.parametrize(
        ("code", "theta", "now", "force"),
        [
            ("viscous_damping", [2.0], {"argument": 3.0}, -6.0),
            ("coulomb_friction", [3.0], {"argument": 2.0, "own": 9.0}, -3.0),
            ("coulomb_friction", [3.0], {"argument": -2.0}, 3.0),
            ("coulomb_friction", [3.0], {"argument": 0.0, "own": 1.25}, -1.25),  # rest carries the load
            ("coulomb_friction", [3.0], {"argument": 0.02, "own": 1.0, "step": 0.01}, -3.0),
            (
                "coulomb_friction",
                [3.0],
                {"argument": 0.01, "own": 1.0, "step": 0.01},
                -2.0,
            ),  # stops in a step
            ("asymmetric_friction", [2.0, 0.5], {"argument": 1.0}, -3.0),
            ("asymmetric_friction", [2.0, 0.5], {"argument": -1.0}, 1.0),
            ("stribeck_friction", [2.0, 1.5, 0.5, 2.0], {"argument": 0.5}, -2 * (1 + 0.5 * np.exp(-1))),
            (
                "stribeck_friction",
                [2.0, 1.5, 0.5, 2.0],
                {"argument": 0.0, "own": 2.9},
                -2.9,
            ),  # breakaway at 3
            ("load_friction", [0.1], {"second": np.nan, "argument": 1.0, "own": -5.0}, -0.5),
            ("load_friction", [0.1], {"second": -3.0, "argument": -1.0, "own": -5.0}, 0.3),
            ("clearance", [10.0, 0.2, 0.1], {"argument": 0.5}, -2.0),
            ("clearance", [10.0, 0.2, 0.1], {"argument": -0.3}, 2.0),
            ("clearance", [10.0, 0.2, 0.1], {"argument": 0.25}, 0.0),
            ("overflow", [5.0], {"argument": 4.0, "own": 3.0}, 0.0),
            ("overflow", [5.0], {"argument": 5.0, "own": 3.0}, -3.0),
            ("overflow", [5.0], {"argument": 6.0, "own": -3.0}, 0.0),  # falls freely
            ("spill", [2.0, 5.0, 1.5], {"argument": 9.0}, -16.0),
            ("spill", [2.0, 5.0, 1.5], {"argument": 4.0, "own": 3.0}, 0.0),
            ("spill", [2.0, 5.0, 0.5], {"argument": 5.01, "step": 1.0}, -0.01),  # down to the rim in a step
            ("linear_stiffness", [2.0, 0.5], {"argument": -2.0}, 5.0),
            ("cubic_stiffness", [2.0], {"argument": -2.0}, 16.0),
            ("quadratic_stiffness", [2.0], {"argument": -2.0}, -8.0),
            ("bilinear_stiffness", [2.0, -1.0], {"argument": -3.0}, 6.0),
            ("bilinear_stiffness", [2.0, 1.0], {"argument": -3.0}, 0.0),
            ("gravity", [9.81, 0.0], {"argument": np.pi / 6}, -4.905),
            ("gravity", [9.81, np.pi / 2], {"argument": 0.0}, -9.81),
            ("cogging", [2.0, 6.0, 0.0, 0.5, 0.0], {"argument": np.pi / 12}, 2.0),
            ("cogging", [2.0, 6.0, 0.0, 0.5, 0.25], {"argument": np.pi / 12}, 1.5),
            ("constant_load", [-1.5], {}, -1.5),
            ("quadratic_drag", [0.5], {"argument": -2.0}, 2.0),
            ("root_outflow", [2.0, 0.5, 0.0], {"argument": 9.0}, -6.0),
            ("root_outflow", [2.0, 0.5, 7.0], {"argument": 9.0}, -8.0),
            ("root_outflow", [2.0, 0.5, 0.0], {"argument": -1.0}, 0.0),
            ("bilinear_input", [0.5, 0.0, 0.0], {"argument": 4.0, "second": 3.0}, 6.0),
            ("bilinear_input", [0.5, 5.0, 1.0], {"argument": 4.0, "second": 3.0}, -1.0),
            ("coupling", [0.5, 0.0], {"argument": 4.0, "second": 3.0}, 1.5),
            ("coupling", [0.5, 2.0], {"argument": 4.0, "second": 3.0}, 0.5),
            ("quadratic_coupling", [0.5, 0.0], {"argument": 4.0, "second": -3.0}, -4.5),
            ("quadratic_coupling", [0.5, 1.0], {"argument": 4.0, "second": 3.0}, 2.0),
            ("gain_drift", [0.1, 3.0, 0.0], {**ALONE, "time": 3.0}, 0.4 * (1 - np.exp(-1))),
            ("gain_drift", [0.1, 3.0, 5.0], {**ALONE, "time": 3.0}, -0.1 * (1 - np.exp(-1))),
            ("gain_drift", [0.1e9, 1e9, 0.0], {**ALONE, "time": 3.0}, 1.2 * (1 - 1.5e-9)),  # a line
            ("gain_drift", [0.1, 3.0, 5.0], {"second": 7.0, "time": 3.0}, 0.2 * (1 - np.exp(-1))),
            ("temperature_gain", [0.1, 0.0, 0.0], {"argument": 4.0, "second": 3.0}, 1.2),
            ("temperature_gain", [0.1, 2.0, 1.0], {"argument": 4.0, "second": 3.0}, 0.3),
            ("additive_drift", [2.0, 3.0, 0.0, 0.0], {"time": 3.0}, 2 * (1 - np.exp(-1))),
            ("additive_drift", [2.0, 0.0, 0.0, 0.0], {"time": 3.0}, 2.0),
            ("additive_drift", [2.0, 1.0, -1.0, 4.0], {"time": np.log(2.0)}, 1.5),  # 2 (1/2 - 1/4 + 4/8)
            ("periodic_disturbance", [2.0, 3.0, 0.5], {"time": 1.5}, 2 * np.sin(5.0)),
            ("backlash", [4.0, 0.1, 0.0, 0.0], {"argument": 1.0, "z": [0.5] * 4 + [1.0]}, 4 * (0.9 - 1.0)),
            ("backlash", [4.0, 0.1, 0.5, 0.0], {"argument": 1.0}, 0.0),  # begins centred
            ("bouc_wen_hysteresis", [4.0, 1.0, 1.0, 1.0, 0.0], {"rate": 1.0, "z": [0.25]}, -1.0),
            ("bouc_wen_hysteresis", [4.0, 1.0, 1.0, 1.0, -0.5], {"rate": 1.0, "z": [0.25]}, 0.0),
            ("presliding_friction", [4.0, 0.1, 1.0, 1.0, 0.0], {"argument": 0.5, "z": [0.25]}, -1.0),
            ("creep", [3.0, 1.0, 1.0, 0.0], {"z": [0.1, 0.2, 0.3]}, -0.6),
            ("extra_mode", [3.0, 1.0, 0.1], {"z": [0.1, 0.2], "second": np.nan}, 0.3),
            ("extra_mode", [3.0, 1.0, 0.1], {"z": [0.1, 0.2], "second": 5.0}, 0.3),
            ("prandtl_ishlinskii", [3.0, 1.0, 0.0, 0.0], {"argument": 0.4}, 0.0),
        ],
    )
    def test_a_force_worked_by_hand(self, code, theta, now, force):
        now = dict(now)
        if "z" in now:
            now["z"] = np.concatenate([now["z"], np.zeros(MAX_MEMORY - len(now["z"]))])
        np.testing.assert_allclose(force_of(CATALOGUE[code], theta, **now)[0], force, rtol=1e-12, atol=1e-15)

    @given(
        v=st.floats(-10, 10),
        own=st.floats(-50, 50),
        limit=st.floats(0, 20),
        asymmetry=st.floats(-1, 1),
        step=st.floats(1e-4, 0.1),
    )
    @example(v=0.0, own=1.0, limit=2.0, asymmetry=0.0, step=0.01)
    def test_dry_friction_never_exceeds_its_limit_nor_drives(self, v, own, limit, asymmetry, step):
        force, _ = force_of(
            CATALOGUE["asymmetric_friction"], [limit, asymmetry], v, own=own, step=step, pure=True
        )
        forward, backward = limit * (1 + asymmetry), limit * (1 - asymmetry)
        assert -forward * (1 + 1e-12) <= force <= backward * (1 + 1e-12)
        # away from rest it opposes in full
        if abs(v) > 2 * step * (forward + backward):
            assert force == (-forward if v > 0 else backward)

    @given(own=st.floats(-1, 1), limit=st.floats(1.0, 5.0))
    def test_dry_friction_at_rest_balances_any_load_it_can_carry(self, own, limit):
        assert force_of(CATALOGUE["coulomb_friction"], [limit], 0.0, own=own, pure=True)[0] == -own

    def test_play_force_withholds_what_the_play_operator_withholds(self):
        x = wideband(300)
        z = np.zeros(MAX_MEMORY)
        forces = []
        for value in x:
            force, dz = force_of(CATALOGUE["backlash"], [2.0, 0.3, 0.0, 0.0], value, z=z)
            z[: len(dz)] = dz
            forces.append(force)
        followed = play(x, 0.3, initial_state=x[0])[:, 0]
        np.testing.assert_allclose(forces, 2.0 * (followed - x), atol=1e-14)

    def test_prandtl_ishlinskii_force_and_transform_are_one_operator(self):
        x, theta = wideband(300), np.array([2.0, 1.5, 0.7, -0.4])
        z = np.zeros(MAX_MEMORY)
        forces = []
        for value in x:
            force, dz = force_of(CATALOGUE["prandtl_ishlinskii"], theta, value, z=z)
            z[: N_PLAYS + 1] = dz
            forces.append(force)
        np.testing.assert_allclose(forces, transformed("prandtl_ishlinskii", x, theta) - x, atol=1e-13)


def mass(substeps=2, k=40.0, c=0.4, dt=DT):
    """Return a mass on a spring with a damper; the second input is a measured channel it does not use."""

    def rates(x, u, p):
        return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0]

    return ODESimulator(
        rates,
        dt=dt,
        parameters={"gain": 1.0, "damping": c, "stiffness": k},
        states=["position [m]", "velocity [m/s]"],
        inputs=["drive [N/kg]", "temperature [K]"],
        substeps=substeps,
    )


@pytest.fixture(scope="module")
def oscillator():
    return mass()


def placed_on_mass(effect, theta, kind="state"):
    weights = (
        ((1.0, 0.0) if effect.argument in ("position", "any") else (0.0, 1.0)) if kind == "state" else ()
    )
    channel = (0.0, 1.0, 0.0, 0.0)
    rate = (0.0, 0.0, 0.0, 1.0)
    seconds = {"input": (1.0, 0.0, 0.0, 0.0), "channel": channel, "other": channel, "alike": rate}
    second = seconds.get(effect.second, ())
    return PlacedEffect(effect, Port(kind, 1 if kind == "state" else 0), weights, second, theta=tuple(theta))


class TestRuns:
    @pytest.mark.parametrize(
        ("effect", "kind"), [(effect, kind) for effect in ALL for kind in effect.ports], ids=str
    )
    def test_an_effect_on_a_mass_stays_finite_and_shows(self, oscillator, effect, kind):
        u = np.column_stack([20 * wideband(), 20.0 + wideband(seed=2)])
        x = np.zeros((1200, 2))
        run = oscillator.simulate(u)[:, 0]
        x[:, 0], x[:, 1] = run, np.gradient(run, DT)
        own = np.gradient(x[:, 1], DT)
        signal = {"input": u[:, 0], "output": run}.get(kind)
        if signal is None:
            signal = x[:, 0] if effect.argument in ("position", "any") else x[:, 1]
        else:
            own = signal
        seconds = {"input": u[:, 0], "channel": u[:, 1], "other": u[:, 1], "alike": x[:, 1]}
        second = seconds.get(effect.second)
        setting = setting_of(signal, own=own, second=second)
        starts = effect.starts(setting)
        if effect.code == "root_outflow":
            assert len(starts) == 0  # a velocity is no level
            starts = np.array([[1.0, 0.5, 2.0]])
        assert len(starts)
        for theta in starts:
            changed = oscillator.with_effects([placed_on_mass(effect, theta, kind)]).simulate(u)[:, 0]
            assert np.all(np.isfinite(changed))
            difference = _size(changed - run) / _size(run)
            assert 1e-4 < difference < 3

    @pytest.mark.parametrize("effect", [e for e in FORCES if not e.after], ids=by_code)
    def test_a_run_is_the_same_where_the_kernel_looks_for_anything_special(
        self, oscillator, effect, ordinary, level
    ):
        u = np.column_stack([20 * wideband(), 20.0 + wideband(seed=2)])
        whole, at_rest = _whole(1200)
        limit = placed_on_mass(CATALOGUE["overflow"], [0.0, 0.0])  # acts after each step, here at no strength
        for theta in starts_of(effect, ordinary, level)[:2]:
            acting = placed_on_mass(effect, theta)
            alone = oscillator.run(u, whole, at_rest, effects=[acting])
            beside = oscillator.run(u, whole, at_rest, effects=[acting, limit], strength=[1.0, 0.0])
            np.testing.assert_array_equal(alone.x, beside.x)

    @pytest.mark.parametrize(
        ("code", "theta"),
        [
            ("coulomb_friction", [3.0]),
            ("asymmetric_friction", [3.0, 0.2]),
            ("stribeck_friction", [2.5, 1.3, 0.1, 2.0]),
        ],
    )
    def test_dry_friction_sticks_without_chatter_or_creep(self, oscillator, code, theta):
        simulator = oscillator.with_effects([placed_on_mass(CATALOGUE[code], theta)])
        u = np.column_stack([2.0 + 0.2 * np.sin(np.arange(1000)), np.zeros(1000)])
        y = simulator.simulate(u)[:, 0]
        assert np.max(np.abs(y)) < 1e-9
        moved = simulator.simulate(np.column_stack([np.full(1000, 8.0), np.zeros(1000)]))[:, 0]
        assert moved.max() > 0.1
        assert np.ptp(moved[-300:]) < 1e-9  # and comes to rest for good

    def test_coulomb_friction_takes_the_same_off_every_half_swing(self):
        friction, k = 0.5, 40.0
        simulator = mass(substeps=10, k=k, c=0.0, dt=1e-3).with_effects(
            [placed_on_mass(CATALOGUE["coulomb_friction"], [friction])]
        )
        y = simulator.simulate(np.zeros((2500, 2)), x0=[0.2, 0.0])[:, 0]
        turns = np.flatnonzero(np.diff(np.sign(np.diff(y)))) + 1
        peaks = np.abs(np.concatenate([[0.2], y[turns[:4]]]))
        np.testing.assert_allclose(-np.diff(peaks), 2 * friction / k, rtol=5e-3)

    def test_friction_that_a_load_turns_about_in_passing_changes_sign_within_the_step(self):
        u = np.column_stack([20 * wideband(), np.zeros(1200)])
        coarse, fine = (
            mass(substeps=substeps, dt=0.02)
            .with_effects([placed_on_mass(CATALOGUE["coulomb_friction"], [0.3])])
            .simulate(u)[:, 0]
            for substeps in (1, 64)
        )
        without = mass(dt=0.02).simulate(u)[:, 0]
        # a sign that changes at the next stage leaves a hundredth and more of what friction does
        assert _size(coarse - fine) < 0.003 * _size(without - fine)

    @pytest.mark.parametrize("d", [1e-12, 1e-4, 1e-2])
    def test_presliding_friction_never_stiffens_the_run(self, oscillator, d):
        effect = placed_on_mass(CATALOGUE["presliding_friction"], [3.0, d, 1.3, 0.1, 0.01])
        u = np.column_stack([20 * wideband(), np.zeros(1200)])
        y = oscillator.with_effects([effect]).simulate(u)[:, 0]
        assert np.max(np.abs(y)) < np.max(np.abs(oscillator.simulate(u)))

    def test_presliding_friction_is_a_spring_before_breakaway(self, oscillator):
        friction, d = 3.0, 0.01
        effect = placed_on_mass(CATALOGUE["presliding_friction"], [friction, d, 1.0, 0.1, 0.05])
        u = np.column_stack([np.full(3000, 0.03), np.zeros(3000)])
        y = oscillator.with_effects([effect]).simulate(u)[-1, 0]
        np.testing.assert_allclose(
            y, 0.03 / (40.0 + friction / d), rtol=0.02
        )  # dx/dF, but for the bristle's slip

    def test_a_tank_holds_its_rim_and_spills_the_share_onward(self):
        def tanks(x, u, p):
            return p[0] * u[0] - p[1] * x[0], p[1] * x[0] - p[1] * x[1]

        simulator = ODESimulator(
            tanks,
            dt=0.05,
            parameters={"gain": 1.0, "outflow": 0.5},
            states=["upper [m]", "lower [m]"],
            inputs=["pump [V]"],
        )
        rim, share, n = 3.0, 0.25, 1000
        effect = PlacedEffect(
            CATALOGUE["overflow"], Port("state", 0), (1.0, 0.0), onward=1, theta=(rim, share)
        )
        full = simulator.with_effects([effect])
        windows_x = full.run(
            np.full((n, 1), 2.5),
            *_whole(n),
        ).x
        assert windows_x[:, 0].max() <= rim * (1 + 1e-9)
        inflow, lost = 2.5, 2.5 - 0.5 * rim
        np.testing.assert_allclose(windows_x[-1], [rim, (inflow - (1 - share) * lost) / 0.5], rtol=1e-6)

    def test_a_tank_drains_as_torricelli_says(self):
        def tank(x, u, p):
            return (p[0] * u[0],)

        simulator = ODESimulator(tank, dt=0.01, parameters={"gain": 1.0}, states=["level"], inputs=["pump"])
        effect = PlacedEffect(CATALOGUE["root_outflow"], Port("state", 0), (1.0,), theta=(0.8, 0.5, 0.0))
        h = simulator.with_effects([effect]).simulate(np.zeros((400, 1)), x0=[1.0])[:, 0]
        t = 0.01 * np.arange(400)
        np.testing.assert_allclose(h[:240], (1 - 0.4 * t[:240]) ** 2, atol=1e-6)
        assert np.all(h[-100:] >= 0)
        assert h[-1] < 1e-6


def _whole(n):
    return Windows.whole([slice(0, n)]), np.zeros((1, 2))


SWINGING = _along_parabolas(np.array([[0.0, 1.0], [-100.0, -2.0]]), np.array([0.0, 100.0]), DT)


class TestTransforms:
    @pytest.mark.parametrize("effect", [e for e in TRANSFORMS if e.amplitude is not None], ids=by_code)
    def test_what_a_transform_adds_is_linear_in_its_amplitude(self, effect, ordinary):
        theta = effect.starts(ordinary)[0]
        half = theta.copy()
        half[effect.amplitude] *= 0.5

        def added(values):
            changed = effect.transform(ordinary.argument, ordinary.second, DT, values, ordinary.first)
            return changed - ordinary.argument

        np.testing.assert_allclose(added(half), 0.5 * added(theta), atol=1e-12)

    @pytest.mark.parametrize("effect", TRANSFORMS, ids=by_code)
    def test_a_transform_keeps_gaps_to_themselves(self, effect, ordinary):
        broken = ordinary.argument.copy()
        broken[[0, 300, 301, 302, 700]] = np.nan
        for theta in effect.starts(ordinary):
            out = effect.transform(broken, ordinary.second, DT, theta, ordinary.first)
            np.testing.assert_array_equal(np.isnan(out), np.isnan(broken))

    @pytest.mark.parametrize("effect", [e for e in TRANSFORMS if e.code != "stuck_sensor"], ids=by_code)
    def test_a_transform_begins_anew_with_each_session(self, effect, ordinary):
        second = ordinary.second
        for theta in effect.starts(ordinary):
            whole = effect.transform(ordinary.argument, second, DT, theta, np.array([0, 700]))
            parts = [
                effect.transform(ordinary.argument[part], second[part], DT, theta, np.array([0]))
                for part in (slice(0, 700), slice(700, None))
            ]
            np.testing.assert_allclose(whole, np.concatenate(parts), atol=1e-14)

    @pytest.mark.parametrize(
        ("code", "theta"),
        [
            ("backlash", [1.0, 0.0, 0.5, 0.0]),
            ("dead_zone", [0.0, 0.0, 0.0]),
            ("dead_zone", [0.0, 0.5, 0.2]),
            ("valve_stiction", [0.0, 0.5, 0.0, 0.0]),
            ("input_saturation", [-1e9, 1e9, 0.0]),
            ("input_saturation", [-1e9, 1e9, 3.0]),
            ("sensor_clip", [-1e9, 1e9]),
            ("rate_limit", [1e9, 0.0, 0.0]),
            ("rate_limit", [1e9, 0.0, 1.0]),
            ("asymmetric_rate_limit", [1e9, 0.0, 0.0, 0.3]),
            ("input_polynomial", [0.0, 0.0, 0.3]),
            ("temperature_gain", [0.0, 1.0, 2.0]),
            ("bouc_wen_hysteresis", [0.0, 1.0, 1.0, 1.0, 0.0]),
            ("prandtl_ishlinskii", [1.0, 0.0, 0.0, 0.0]),
            ("creep", [0.0, 1.0, 1.0, 0.0]),
            ("scale_error", [0.0, 1.0]),
            ("cross_sensitivity", [0.0, 1.0]),
            ("mixed_reading", [0.0]),
            ("delay", [0.0, 0.0]),
            ("lag", [0.0, 0.0, 0.0]),
            ("lag", [0.0, 0.0, 1.0]),
            ("extra_mode", [0.0, 10.0, 0.1]),
            ("quantisation", [0.0]),
            ("quantisation", [1e-9]),
            ("stuck_sensor", [1.0, 0.0, 0.0]),
            ("sensor_bias", [0.0]),
            ("input_offset", [0.0]),
            ("periodic_disturbance", [0.0, 3.0, 0.0]),
            ("additive_drift", [0.0, 3.0, 1.0, 1.0]),
            ("gain_drift", [0.0, 3.0, 0.3]),
        ],
    )
    def test_a_transform_of_no_size_changes_nothing(self, code, theta):
        signal = wideband()
        out = transformed(code, signal, theta, second=wideband(seed=2))
        np.testing.assert_allclose(out, signal, atol=1e-8)

    @pytest.mark.parametrize(
        ("code", "theta"),
        [
            ("backlash", [1.0, 0.3, 0.0, 0.0]),
            ("valve_stiction", [0.6, 0.5, 0.5, 0.0]),
            ("rate_limit", [0.5, 0.0, 0.0]),
            ("rate_limit", [0.5, 0.0, 1.0]),
            ("asymmetric_rate_limit", [0.5, 0.0, 0.0, -0.3]),
            ("bouc_wen_hysteresis", [0.5, 1.0, 1.0, 1.0, 0.0]),
            ("prandtl_ishlinskii", [0.5, 1.0, 0.0, 0.0]),
            ("delay", [0.3, 0.0]),
            ("lag", [0.3, 0.0, 0.0]),
            ("lag", [0.3, 0.0, 1.0]),
            ("extra_mode", [0.5, 10.0, 0.1]),
        ],
    )
    def test_memory_begins_at_rest_on_the_first_value(self, code, theta):
        held = transformed(code, np.full(400, 3.7), theta)
        np.testing.assert_allclose(held, 3.7, rtol=1e-9)

    def test_a_scale_and_what_is_felt_beside_it_worked_by_hand(self):
        assert transformed("scale_error", [-2.0, 0.5, 4.0], [0.1, 1.5]).tolist() == pytest.approx(
            [-2.35, 0.4, 4.25]
        )
        second = np.array([3.0, 2.0, 7.0])
        felt = transformed("cross_sensitivity", [1.0, 1.0, -1.0], [0.5, 2.0], second=second)
        assert felt.tolist() == [1.5, 1.0, 1.5]
        between = transformed("mixed_reading", [1.0, 1.0, -1.0], [0.25], second=second)
        assert between.tolist() == [1.5, 1.25, 1.0]

    def test_saturation_dead_zone_and_steps_worked_by_hand(self):
        signal = [-2.0, -0.5, 0.5, 2.0]
        assert transformed("input_saturation", signal, [-1.0, 1.5, 0.0]).tolist() == [-1.0, -0.5, 0.5, 1.5]
        assert transformed("dead_zone", signal, [0.75, 0.0, 0.0]).tolist() == [-1.25, 0.0, 0.0, 1.25]
        assert transformed("dead_zone", [3.0, 4.5, 7.0], [1.0, 5.0, 0.0]).tolist() == [4.0, 5.0, 6.0]
        overlap = transformed("dead_zone", [-1.0, -0.3, 0.4, 1.0], [0.45, 0.05, 0.0, 1.0])  # from -0.4 to 0.5
        np.testing.assert_allclose(overlap, [-0.6, 0.0, 0.0, 0.5], atol=1e-15)
        assert transformed("quantisation", [0.3, 0.8, -1.3], [0.5]).tolist() == [0.5, 1.0, -1.5]
        assert transformed("input_polynomial", [2.0], [0.5, 0.25, 0.0]).tolist() == [6.0]
        assert transformed("input_polynomial", [3.0], [0.5, 0.25, 1.0]).tolist() == [7.0]
        ramps, ends = (
            transformed("rate_limit", [0.0, 1.0, 1.0, 0.0], [0.4, 0.0, of_code], dt=1.0)
            for of_code in (0.0, 1.0)
        )
        assert ramps.tolist() == pytest.approx(
            [0.0, 0.2, 0.6, 0.6]  # means of ramps from 0 to 0.4, 0.4 to 0.8, 0.8 to 0.4
        )
        np.testing.assert_allclose(ends, [0.0, 0.4, 0.8, 0.4], rtol=1e-15)
        from_rest = transformed("rate_limit", [1.0, 1.0, -1.0, -1.0], [0.4, 1.0, 0.0], dt=1.0, first=[0, 2])
        np.testing.assert_allclose(from_rest, [0.2, 0.6, -0.2, -0.6], rtol=1e-15)
        faster_up = transformed(
            "asymmetric_rate_limit", [0.0, 1.0, 1.0, 0.0, 0.0], [0.4, 0.0, 1.0, 0.5], dt=1.0
        )
        np.testing.assert_allclose(faster_up, [0.0, 0.6, 1.0, 0.8, 0.6], rtol=1e-15)
        halved = [0.5, 1 / np.log(2.0), 3.0]  # half way after a second
        drifted = transformed("gain_drift", [1.0, 1.0, 1.0], halved, dt=1.0, first=[0, 2])
        np.testing.assert_allclose(drifted, [1.0, 0.5, 1.0], rtol=1e-15)
        assert transformed("temperature_gain", [2.0], [0.5, 0.0, 0.0], second=np.array([3.0])).tolist() == [
            5.0
        ]
        assert transformed("temperature_gain", [2.0], [0.5, 1.0, 3.0], second=np.array([3.0])).tolist() == [
            1.0
        ]

    def test_a_rounded_corner_worked_by_hand(self):
        """At a lonely corner w log 2 is missing, one width before it w log(1 + 1/e)."""
        levels = transformed("input_saturation", [2.0, 1.5, 50.0], [-100.0, 2.0, 0.5])
        expected = [2.0 - 0.5 * np.log(2.0), 1.5 - 0.5 * np.log1p(np.exp(-1)), 2.0]
        np.testing.assert_allclose(levels, expected, rtol=1e-14)

    @given(low=st.floats(-3, -0.1), high=st.floats(0.1, 3), w=st.floats(1e-3, 5.0), s=st.floats(-20, 20))
    def test_a_rounded_saturation_is_its_quotient_of_exponentials(self, low, high, w, s):
        middle = 0.5 * (low + high)
        out, before, after = transformed(
            "input_saturation", [s, middle - 1e-6, middle + 1e-6], [low, high, w]
        )
        soft = low + w * (np.logaddexp(0.0, (s - low) / w) - np.logaddexp(0.0, (s - high) / w))
        slope = np.tanh((high - low) / (4 * w))
        np.testing.assert_allclose(out, middle + (soft - middle) / slope, atol=1e-11)
        np.testing.assert_allclose((after - before) / 2e-6, 1.0, rtol=1e-6)  # small signals pass as they are

    def test_a_saturation_that_is_all_knee_is_a_hyperbolic_tangent(self):
        signal = wideband()
        out = transformed("input_saturation", signal, [0.5, 0.5, 0.8])
        np.testing.assert_allclose(out, 0.5 + 1.6 * np.tanh((signal - 0.5) / 1.6), atol=1e-8)

    @given(w=st.sampled_from([0.0, 5e-324, 1e-300, 1e-12]), s=st.floats(-1e300, 1e300))
    @example(w=5e-324, s=-1.0)
    def test_a_saturation_without_width_is_the_sharp_clip(self, w, s):
        np.testing.assert_allclose(
            transformed("input_saturation", [s], [-1.0, 1.5, w]), np.clip([s], -1.0, 1.5), rtol=0, atol=1e-12
        )

    @given(st.floats(-5.0, 5.0))
    def test_a_dead_zone_is_sought_within_sight_only(self, offset):
        signal = offset + wideband()
        setting, effect = setting_of(signal), CATALOGUE["dead_zone"]
        low, high = effect.limits(setting).T
        rows = effect.starts(setting)
        assert np.all((low <= rows) & (rows <= high))
        c_low, c_high = low[1], high[1]
        reach = np.ptp(signal)
        assert (c_low, c_high) == pytest.approx((signal.min() - reach, signal.max() + reach))
        assert high[2] == pytest.approx(0.25 * reach)  # rounded over more it would be any curve

    @given(c=st.floats(-50, 50), w=st.floats(0, 2))
    def test_a_dead_zone_moves_with_its_centre(self, c, w):
        signal = wideband(100)
        here, there = (transformed("dead_zone", signal + at, [0.6, at, w]) - at for at in (0.0, c))
        np.testing.assert_allclose(there, here, atol=1e-12)

    @pytest.mark.parametrize("reference", [-20.0, 0.0, 4.0])
    def test_a_reference_moves_what_a_gain_acts_on(self, reference):
        """About a level the change is that of the signal counted from it."""
        signal, second = wideband(200), 300.0 + wideband(200, seed=2)
        for code, theta in (
            ("gain_drift", [0.4, 1.5]),
            ("temperature_gain", [0.4, 300.0]),
            ("input_polynomial", [0.3, -0.02]),
        ):
            about = transformed(code, signal + reference, [*theta, reference], second=second) - reference
            np.testing.assert_allclose(
                about, transformed(code, signal, [*theta, 0.0], second=second), atol=1e-9
            )

    def test_a_sticking_valve_holds_then_jumps(self):
        """S = 1, J = 0.4: the stem leaves at 0.7 from relaxed, then trails by 0.3; a reversal takes S."""
        command = [0.0, 0.4, 0.6, 0.8, 1.0, 0.4, 0.1, -0.1]
        stem = transformed("valve_stiction", command, [1.0, 0.4, 0.0, 0.0])
        np.testing.assert_allclose(stem, [0.0, 0.0, 0.0, 0.5, 0.7, 0.7, 0.7, 0.2], atol=1e-12)

    def test_a_valve_may_stick_again_after_every_jump(self):
        """The stem leaves at 0.7, trails by 0.3, and goes on when the command is 0.7 ahead again."""
        command = [0.0, 0.6, 0.8, 1.0, 1.15, 1.25, 0.9, 0.2]
        stem = transformed("valve_stiction", command, [1.0, 0.4, 1.0, 0.0])
        np.testing.assert_allclose(stem, [0.0, 0.0, 0.5, 0.5, 0.5, 0.95, 0.95, 0.5], atol=1e-12)

    def test_a_valve_without_jump_is_a_play(self):
        signal = wideband()
        np.testing.assert_allclose(
            transformed("valve_stiction", signal, [0.6, 0.0, 0.0, 0.0]),
            transformed("backlash", signal, [1.0, 0.3, 0.0, 0.0]),
            atol=1e-12,
        )

    def test_a_delay_of_whole_samples_is_a_shift(self):
        signal = wideband()
        late = transformed("delay", signal, [5 * DT, 0.0])
        np.testing.assert_allclose(late[5:], signal[:-5], atol=1e-12)
        np.testing.assert_allclose(late[:5], signal[0])

    @pytest.mark.parametrize("whole", range(20))
    def test_a_delay_of_a_held_command_worked_by_hand_at_its_beginning(self, whole):
        """Three tenths of a step are still as before the record, at half of the first value, 2."""
        signal = np.full(24, 2.0)
        mean, rise = CATALOGUE["delay"].held(signal, 0.1, [0.1 * (whole + 0.3), 0.5], [0])
        np.testing.assert_allclose(mean, [1.0] * whole + [1.7] + [2.0] * (23 - whole), rtol=1e-12)
        np.testing.assert_allclose(rise[whole], 6 * 0.3 * 0.7 * (2.0 - 1.0), rtol=1e-12)

    @pytest.mark.parametrize(
        ("code", "theta", "form"),
        [("delay", 5 * DT, []), ("lag", 0.3, [0.0]), ("lag", 0.3, [1.0]), ("rate_limit", 2.0, [0.0])],
    )
    def test_what_follows_late_may_be_at_rest_at_zero_when_a_record_begins_with_a_step(
        self, code, theta, form
    ):
        """As if a command of zero had gone before."""
        signal = 2.0 + wideband()
        longer = transformed(code, np.concatenate([np.zeros(50), signal]), [theta, 0.0, *form])
        begun = transformed(code, signal, [theta, 1.0, *form])
        # up to the ramp of one step that a straight line draws from the last zero to the first value
        np.testing.assert_allclose(begun, longer[50:], atol=0.02 * np.max(signal))
        assert np.abs(transformed(code, signal, [theta, 0.0, *form]) - longer[50:]).max() > 0.5

    @pytest.mark.parametrize("more", [(), (0.4,), (-1.0,)])
    @pytest.mark.parametrize("rate", [0.0, 0.3, 1.0, 4.0])
    def test_ramps_to_held_values_do_to_two_integrators_what_fine_steps_show(self, rate, more):
        """A mass that a limited force pushes: its speed and its place at each sample."""
        held = np.round(2 * np.random.default_rng(3).normal(size=30))
        limit = CATALOGUE["asymmetric_rate_limit" if more else "rate_limit"]
        mean, rise = limit.held(held, 1.0, [rate, 0.5, 0.0, *more], [0, 11])
        n = 2000
        up, down = (rate / n * (1.0 + sign * sum(more)) for sign in (1.0, -1.0))
        force, fine = 0.5 * held[0], []
        for k, wanted in enumerate(held):
            force = 0.5 * wanted if k == 11 else force
            for _ in range(n):
                before, force = force, force + np.clip(wanted - force, -down, up)
                fine.append(0.5 * (before + force))
        steps = np.array(fine).reshape(-1, n)
        lever = (np.arange(n) + 0.5) / n - 0.5
        np.testing.assert_allclose(mean, steps.mean(axis=1), atol=1e-3)
        np.testing.assert_allclose(rise, 12 * (steps * lever).mean(axis=1), atol=1e-2)

    def test_a_rate_that_code_limits_is_held_in_between(self):
        held = np.array([0.0, 1.0, 1.0, np.nan, 0.0])
        mean, rise = CATALOGUE["rate_limit"].held(held, 1.0, [0.4, 0.0, 1.0], [0])
        np.testing.assert_allclose(mean, [0.0, 0.4, 0.8, np.nan, 0.4], rtol=1e-15)
        np.testing.assert_array_equal(rise, [0.0, 0.0, 0.0, np.nan, 0.0])

    @pytest.mark.parametrize("T", [0.02, 0.3, 4.0])
    def test_a_lag_is_the_filter_it_says(self, T):
        signal = wideband() - wideband()[0]
        _, expected, _ = lsim(([1.0], [T, 1.0]), signal, np.arange(signal.size) * DT)
        np.testing.assert_allclose(transformed("lag", signal, [T, 0.0, 0.0]), expected, atol=1e-10)

    @pytest.mark.parametrize("T", [0.02, 0.3, 4.0])
    def test_a_lag_from_sample_to_sample_is_the_filter_it_says(self, T):
        signal = wideband() - wideband()[0]
        of_code = lfilter([1.0 - np.exp(-DT / T)], [1.0, -np.exp(-DT / T)], signal)
        np.testing.assert_allclose(transformed("lag", signal, [T, 0.0, 1.0]), of_code, atol=1e-12)
        of_parts = transformed("lag", signal, [T, 0.0, 0.0])
        half = 0.5 * (of_code + of_parts)
        np.testing.assert_allclose(transformed("lag", signal, [T, 0.0, 0.5]), half, atol=1e-12)

    def test_a_lag_from_sample_to_sample_holds_in_between(self):
        """What it reads within the steps changes nothing; what it made of a sample stays until the next."""
        signal, middle, end = np.random.default_rng(5).normal(size=(3, 40))
        lag, theta = CATALOGUE["lag"], [0.03, 0.4, 1.0]
        made = lag.transform(signal, None, DT, theta, [0, 17])
        for known in lag.curved(signal, middle, end, DT, theta, [0, 17]):
            np.testing.assert_allclose(known, made, atol=1e-12)
        mean, rise = lag.held(signal, DT, theta, [0, 17])
        np.testing.assert_allclose(mean, made, atol=1e-12)
        np.testing.assert_array_equal(rise, 0.0)

    @pytest.mark.parametrize(("w", "zeta"), [(3.0, 0.05), (20.0, 0.5), (1.0, 3.0)])
    def test_an_extra_mode_is_the_filter_it_says(self, w, zeta):
        signal = wideband() - wideband()[0]
        _, mode, _ = lsim(([w * w], [1.0, 2 * zeta * w, w * w]), signal, np.arange(signal.size) * DT)
        expected = signal + 0.4 * (mode - signal)
        np.testing.assert_allclose(transformed("extra_mode", signal, [0.4, w, zeta]), expected, atol=1e-9)

    def test_creep_goes_on_like_the_logarithm_of_time(self):
        """From T to ten T, the response to a step grows by nearly the same in each half octave."""
        step = np.concatenate([[0.0], np.ones(40000)])
        slow = transformed("creep", step, [1.0, 1.0, 1.0, 0.0])
        at = np.searchsorted(np.arange(step.size) * DT, np.geomspace(1, 10, 7))
        growth = np.diff(slow[at])
        assert growth.max() / growth.min() < 1.4
        np.testing.assert_allclose(slow[-1], 2.0, atol=1e-3)

    def test_creep_of_no_width_is_one_slow_pole(self):
        signal = wideband() - wideband()[0]
        _, slow, _ = lsim(([1.0], [2.0, 1.0]), signal, np.arange(signal.size) * DT)
        np.testing.assert_allclose(
            transformed("creep", signal, [0.4, 2.0, 0.0, 0.0]), signal + 0.4 * slow, atol=1e-9
        )

    @pytest.mark.parametrize(("lacking", "at_first"), [(0.0, 2.4), (1.0, 2.0), (0.5, 2.2)])
    def test_creep_begins_with_what_was_there_before_the_record(self, lacking, at_first):
        held = transformed("creep", np.full(2000, 2.0), [0.2, 1.0, 0.0, lacking])
        assert held[0] == pytest.approx(at_first)
        assert held[-1] == pytest.approx(2.4, abs=1e-3)  # at rest whatever was before

    def test_creep_of_two_decades_follows_the_logarithm_of_time_over_them(self):
        step = np.concatenate([[0.0], np.ones(40000)])
        slow = transformed("creep", step, [1.0, 0.5, 2.0, 0.0])
        at = np.searchsorted(np.arange(step.size) * DT, np.geomspace(0.5, 50, 9))
        line = np.polynomial.Polynomial.fit(np.arange(9), slow[at], 1)
        assert np.max(np.abs(line(np.arange(9)) - slow[at])) < 0.05

    @pytest.mark.parametrize(
        ("run", "theta"),
        [
            (_bouc_wen_run, (0.5, 1.0, 1.5, 0.0)),
            (_bouc_wen_run, (0.5, -1.4, 1.5, 0.4)),
            (_bouc_wen_run, (1e-4, 1.0, 1.0, 0.0)),
            (_weighted_plays_run, (1.0, 0.5, 0.3)),
            (_creep_run, (DT, 0.5, 1.0, 0.3)),
            (_plays_run, (0.3, 0.5, -0.7)),
            (_stiction_run, (0.5, 0.2, 0.5, 0.6)),
            (_rate_limit_run, (0.05, 0.03, 0.8)),
            (_average_run, (0.9, 0.3, 1)),
            (_average_run, (0.9, 0.3, 0)),
            (_following_run, (*SWINGING, 0.3)),
        ],
    )
    def test_series_kernels_agree_with_their_python_form(self, run, theta):
        signal = wideband(60)
        if run is _following_run:
            signal = np.column_stack([signal, wideband(60, seed=2), wideband(60, seed=3)])
        np.testing.assert_allclose(run(signal, *theta), run.py_func(signal, *theta), rtol=1e-12, atol=1e-15)

    @pytest.mark.parametrize("weights", [weights_along_line, weights_along_line.py_func])
    def test_what_a_lag_keeps_of_a_step_along_a_line_is_worked_by_hand(self, weights):
        """T x' = s - x over one T, with s = a + (b - a) t/T from x: x/e + a (1 - 2/e) + b/e."""
        np.testing.assert_allclose(weights(1.0), np.array([1.0, np.e - 2.0, 1.0]) / np.e, rtol=1e-14)

    def test_a_stuck_sensor_holds_the_value_it_stuck_at(self):
        signal = wideband()
        stuck = transformed("stuck_sensor", signal, [2.0, 1.0, 0.0])
        np.testing.assert_allclose(stuck[200:300], signal[200])
        np.testing.assert_array_equal(np.delete(stuck, np.s_[200:300]), np.delete(signal, np.s_[200:300]))
        off = transformed("stuck_sensor", signal, [2.0, 1.0, 0.5])
        np.testing.assert_allclose(off[200:300], signal[200] + 0.5)

    def test_runs_of_one_value_are_held_where_values_change_otherwise(self):
        signal = wideband()
        signal[100:105], signal[200:203] = signal[100], signal[200]  # three may be chance
        top = int(np.argmax(signal))
        signal[top : top + 9] = signal.max()  # the range ends there
        assert held_runs(signal) == [(100, 105)]
        assert held_runs(np.append(np.nan, signal)) == [(101, 106)]
        assert held_runs(np.round(signal)) == []
        coarse = np.round(50.0 * np.random.default_rng(0).normal(size=60000))
        # four in a row its resolution may have by chance
        coarse[3000:3004], coarse[9000:9020] = coarse[3000], coarse[9000]
        assert held_runs(coarse) == [(9000, 9020)]
        assert held_runs(np.full(9, 2.0)) == held_runs(np.full(9, np.nan)) == held_runs(np.empty(0)) == []

    @pytest.mark.parametrize(
        ("code", "theta"),
        [
            ("delay", [0.013, 0.0]),
            ("delay", [0.207, 0.0]),
            ("lag", [0.003, 0.0, 0.0]),
            ("lag", [0.4, 0.0, 0.0]),
            ("extra_mode", [0.7, 60.0, 0.1]),
            ("extra_mode", [0.7, 2.0, 3.0]),
        ],
    )
    def test_what_bends_within_steps_is_followed_exactly(self, code, theta):
        """Parabolas from sample to sample, put in as a signal a hundred times as finely sampled."""
        rng, fine = np.random.default_rng(5), 100
        signal, middle = rng.normal(size=(2, 40))
        share = np.arange(fine) / fine
        after = np.append(signal[1:], signal[-1])
        begin, rest = signal[:, None], 4 * middle - 3 * signal - after
        bent = (begin + share * (rest[:, None] + share * 2 * (signal - 2 * middle + after)[:, None])).ravel()
        effect = CATALOGUE[code]
        exact = effect.transform(bent, None, DT / fine, theta, [0])
        known = effect.curved(signal, middle, after, DT, theta, [0])
        np.testing.assert_allclose(known[0], exact[::fine], atol=3e-3)
        np.testing.assert_allclose(known[1], exact[fine // 2 :: fine], atol=3e-3)
        straight = effect.transform(signal, None, DT, theta, [0])
        assert np.abs(straight - exact[::fine]).max() > 10 * np.abs(known[0] - exact[::fine]).max()
        line = 0.5 * (signal + after)
        np.testing.assert_allclose(
            effect.curved(signal, line, after, DT, theta, [0])[0], straight, atol=1e-12
        )

    def test_what_jumps_at_the_samples_is_followed_exactly(self):
        """A signal that is held from sample to sample."""
        held = (np.random.default_rng(5).normal(size=40),) * 3
        lag, delay, mode = (CATALOGUE[code].curved for code in ("lag", "delay", "extra_mode"))
        begin, middle, end = lag(*held, DT, [0.03, 0.0, 0.0], [0])
        np.testing.assert_allclose(end, held[0] + (begin - held[0]) * np.exp(-DT / 0.03), atol=1e-12)
        np.testing.assert_allclose(middle, held[0] + (begin - held[0]) * np.exp(-DT / 0.06), atol=1e-12)
        np.testing.assert_allclose(begin[1:], end[:-1], atol=1e-12)
        begin, middle, end = delay(*held, DT, [2.25 * DT, 0.0], [0])
        np.testing.assert_allclose(begin[3:], held[0][:-3], atol=1e-12)
        np.testing.assert_allclose(middle[2:], held[0][:-2], atol=1e-12)
        np.testing.assert_allclose(end[2:], held[0][:-2], atol=1e-12)
        begin, middle, end = mode(*held, DT, [0.5, 60.0, 0.1], [0])
        x, w = np.zeros(2), 60.0
        for k, value in enumerate(held[0]):
            x[0] = value if k == 0 else x[0]
            assert begin[k] == pytest.approx(value + 0.5 * (x[0] - value), abs=1e-12)
            x = [value, 0.0] + expm(np.array([[0.0, 1.0], [-w * w, -0.2 * w]]) * DT) @ (x - [value, 0.0])
            assert end[k] == pytest.approx(value + 0.5 * (x[0] - value), abs=1e-12)


class TestHysteresis:
    @given(seed=st.integers(0, 50), q=st.floats(-1, 3))
    @settings(max_examples=15)
    def test_a_larger_swing_wipes_out_the_loops_inside(self, seed, q):
        rng = np.random.default_rng(seed)
        inner = rng.uniform(-0.8, 0.8, 6)
        with_loops = transformed("prandtl_ishlinskii", [0.0, -1.0, *inner, 1.0, 0.3], [1.0, 0.7, q, 0.0])
        without = transformed("prandtl_ishlinskii", [0.0, -1.0, 1.0, 0.3], [1.0, 0.7, q, 0.0])
        np.testing.assert_allclose(with_loops[-2:], without[-2:], atol=1e-12)

    def test_minor_loops_between_the_same_limits_are_congruent(self):
        path = np.linspace(0.0, 0.4, 9)
        swing = np.concatenate([path, path[::-1], path])
        theta = [1.0, 0.7, 0.5, 0.0]
        up = transformed("prandtl_ishlinskii", np.concatenate([[0.0, -1.5], swing]), theta)[2 + 9 :]
        down = transformed("prandtl_ishlinskii", np.concatenate([[0.0, 1.5], swing]), theta)[2 + 9 :]
        np.testing.assert_allclose(up - up[0], down - down[0], atol=1e-12)
        assert abs(up[0] - down[0]) > 0.1

    @pytest.mark.parametrize("r", [-0.5, 0.0, 1.0])
    def test_bouc_wen_loads_along_its_closed_form(self, r):
        """dz/dx = 1 - |z/Y|^n: from rest Y (1 - exp(-x/Y)) for n = 1, Y tanh(x/Y) for n = 2, Y the yield."""
        x, zy = np.linspace(0, 3, 100), 0.8
        first, second = zy / (1 + r), zy / np.sqrt(1 + r)
        for begin in (0.0, 0.4):
            z = _bouc_wen_run(x, zy, r, 1.0, begin)
            np.testing.assert_allclose(z, first * (1 - (1 - begin) * np.exp(-x / first)), atol=2e-3)
        z = _bouc_wen_run(x, zy, r, 2.0, 0.0)
        np.testing.assert_allclose(z, second * np.tanh(x / second), atol=2e-3)

    def test_bouc_wen_that_yields_at_once_is_backlash(self):
        """Sharp, it is a stop; what an input keeps after a stop is a play of the same width."""
        signal = 3.0 * np.sin(np.linspace(0.0, 20.0, 4000))
        lost = transformed("backlash", signal, [1.0, 0.1, 0.0, 0.0])
        sharp = transformed("bouc_wen_hysteresis", signal, [1.0, 0.1 * 2.0 ** (1 / 6), 1.0, 6.0, 0.0])
        assert np.abs(sharp - lost).max() < 0.02
        assert np.abs(signal - lost).max() == pytest.approx(0.1)

    def test_bouc_wen_hardens_along_its_closed_form(self):
        """r = -3/2, n = 1: dz/dx = 1 + z/2zy up, and 1 + 5z/2zy on the way back."""
        zy, up, back = 0.8, np.linspace(0, 1, 200), np.linspace(1, 0.9, 50)
        top = 2 * zy * np.expm1(1 / (2 * zy))
        down = (top + zy / 2.5) * np.exp(-2.5 * (1 - back) / zy) - zy / 2.5
        z = _bouc_wen_run(np.concatenate([up, back]), zy, -1.5, 1.0, 0.0)
        np.testing.assert_allclose(z[:200], 2 * zy * np.expm1(up / (2 * zy)), atol=1e-3)
        np.testing.assert_allclose(z[200:], down, atol=2e-3)

    def test_bouc_wen_holds_the_published_hardening_loop(self):
        """Noel and Schoukens 2016: z' = alpha v - beta (gamma abs(v) z + delta v abs(z)), b + g < 0."""
        alpha, beta, gamma, delta = 5e4, 1e3, 0.8, -1.1
        time = np.linspace(0, 1, 20001)
        x = 1e-3 * (np.sin(4 * np.pi * time) + 0.5 * np.sin(14 * np.pi * time))

        def slope(t, z):
            v = 1e-3 * np.pi * (4 * np.cos(4 * np.pi * t) + 7 * np.cos(14 * np.pi * t))
            return alpha * v - beta * (gamma * abs(v) * z + delta * v * abs(z))

        expected = solve_ivp(slope, (0, 1), [0.0], t_eval=time, rtol=1e-9, atol=1e-9, max_step=1e-3).y[0]
        z = alpha * _bouc_wen_run(x, 1 / (beta * gamma), delta / gamma, 1.0, 0.0)
        np.testing.assert_allclose(z, expected, atol=1e-3 * np.max(np.abs(expected)))

    @given(seed=st.integers(0, 30), r=st.floats(-2.0, 3.0), n=st.floats(0.5, 6.0), zy=st.floats(1e-3, 5.0))
    @settings(max_examples=40)
    def test_bouc_wen_stays_within_its_bound(self, seed, r, n, zy):
        """Loading ends at zy/(1 + r)^(1/n); where it ends nowhere near, the reach bounds it."""
        rng = np.random.default_rng(seed)
        begin, x = rng.uniform(-1, 1), rng.normal(size=40)
        bound = zy * (1 + r) ** (-1 / n) if r > -1 else np.inf
        assert np.max(np.abs(_bouc_wen_run(x, zy, r, n, begin))) <= min(bound, REACH * zy) * (1 + 1e-12)

    @pytest.mark.parametrize(
        ("code", "theta", "off"),
        [
            ("backlash", [1.0, 0.3, 0.0], 0.3),
            ("backlash", [0.5, 0.3, 0.5], 0.15),
            ("prandtl_ishlinskii", [1.0, 1.0, 0.0], 0.55),
            ("valve_stiction", [0.8, 0.5, 0.0], 0.6),  # (S + J)/2
        ],
    )
    @pytest.mark.parametrize("begin", [-1.0, -0.4, 0.5, 1.0])
    def test_a_memory_may_begin_anywhere_in_its_play_and_forgets_it(self, code, theta, off, begin):
        signal = np.concatenate([[2.0, 2.0, 4.0], 2.0 + np.sin(np.linspace(0, 20, 400))])
        begun = transformed(code, signal, [*theta, begin])
        assert begun[0] == pytest.approx(2.0 + begin * off)
        np.testing.assert_allclose(begun[2:], transformed(code, signal, [*theta, 0.0])[2:], atol=1e-12)

    @pytest.mark.parametrize("code", ["bouc_wen_hysteresis", "prandtl_ishlinskii", "backlash"])
    def test_hysteresis_does_not_depend_on_speed(self, code):
        theta = {"bouc_wen_hysteresis": [0.5, 0.4, 1.0, 1.0, 0.5], "prandtl_ishlinskii": [0.5, 0.7, 0.0, 0.0]}
        theta = theta.get(code, [1.0, 0.3, 0.5, 0.0])
        slow = np.sin(np.linspace(0, 10, 4001))
        np.testing.assert_allclose(
            transformed(code, slow, theta)[::4], transformed(code, slow[::4], theta), atol=2e-3
        )

    @pytest.mark.parametrize(
        ("code", "theta"),
        [
            ("bouc_wen_hysteresis", [3.0, 0.4, 1.0, 1.0, 0.0]),
            ("bouc_wen_hysteresis", [3.0, 0.4, 0.0, 2.0, 0.0]),
            ("bouc_wen_hysteresis", [3.0, 0.8, -1.4, 1.0, 0.0]),
            ("prandtl_ishlinskii", [3.0, 0.7, 0.0, 0.0]),
            ("backlash", [3.0, 0.3, 0.0, 0.0]),
        ],
    )
    def test_a_hysteretic_force_takes_energy_out_of_every_cycle(self, code, theta):
        x = np.sin(np.linspace(0, 6 * np.pi, 6001))
        force = transformed(code, x, theta) - x
        work = np.sum(0.5 * (force[2001:] + force[2000:-1]) * np.diff(x[2000:]))
        assert work < -0.1


class TestStarts:
    def test_friction_needs_motion_both_ways(self):
        oneway = setting_of(2.0 + 0.5 * wideband() / 5, own=wideband(seed=1))
        for code in ("coulomb_friction", "asymmetric_friction", "stribeck_friction", "presliding_friction"):
            assert CATALOGUE[code].starts(oneway).size == 0
        assert CATALOGUE["load_friction"].starts(oneway).size == 0
        assert CATALOGUE["bilinear_stiffness"].starts(oneway).size == 0

    @pytest.mark.parametrize("effect", ALL, ids=by_code)
    @pytest.mark.parametrize("n", [1, 2, 3, 8])
    def test_a_short_record_is_no_trouble(self, effect, n):
        x = wideband(8)[:n]
        rate = np.gradient(x, DT) if n > 1 else np.zeros(1)
        setting = Setting(x, rate, -x, x + 1, np.arange(n) * DT, DT, np.array([0]), 0.1 * x)
        assert np.all(np.isfinite(effect.starts(setting)))

    @pytest.mark.parametrize("effect", ALL, ids=by_code)
    def test_a_run_that_broke_off_is_no_trouble(self, effect, ordinary, level):
        whole = ordinary if len(effect.starts(ordinary)) else level
        signals = {"argument", "rate", "own", "second"}
        cut = {
            name: np.where(np.arange(1200) < 900, field, np.nan)
            for name, field in whole._asdict().items()
            if name in signals and field is not None
        }
        broken = whole._replace(**cut, residual=cut["argument"])
        assert len(effect.starts(broken)) > 0
        lost = np.full(1200, np.nan)
        assert effect.starts(broken._replace(**dict.fromkeys(signals, lost), residual=lost)).size == 0

    def test_an_input_of_two_levels_shows_no_curve(self):
        two = setting_of(np.sign(wideband()))
        for code in ("input_saturation", "input_polynomial", "dead_zone"):
            assert CATALOGUE[code].starts(two).size == 0

    def test_a_saturation_that_hardly_bends_its_ends_is_near_a_start(self):
        """Far from where it is at home, all else must move before a fit of it gets anywhere."""
        signal = wideband()
        starts = CATALOGUE["input_saturation"].starts(setting_of(signal))
        bent = [np.abs(transformed("input_saturation", signal, theta) - signal).max() for theta in starts]
        assert 0.001 < min(bent) / np.ptp(signal) < 0.01

    def test_a_small_angle_shows_no_weight(self):
        small = setting_of(0.004 * wideband(), own=wideband(seed=1))
        assert CATALOGUE["gravity"].starts(small).size == 0

    def test_what_is_seen_once_is_no_ripple(self):
        """Two waves are the fewest that repeat; over more than a turn every load does, so one a turn is."""
        way = 0.004 * wideband(2000)
        starts = CATALOGUE["cogging"].starts(setting_of(way, own=wideband(2000, 1)))
        waves = starts[:, 1] * np.ptp(way) / (2 * np.pi)
        assert 2.0 - 1e-9 <= waves.min() < 2.5
        assert CATALOGUE["cogging"].limits(setting_of(way))[1, 0] == pytest.approx(4 * np.pi / np.ptp(way))
        one_and_a_half_turns = 3 * np.pi / np.ptp(way) * way
        assert CATALOGUE["cogging"].limits(setting_of(one_and_a_half_turns))[1, 0] == 1.0

    @given(waves=st.floats(2.0, 15.0), phase=st.floats(0, 6))
    @settings(max_examples=20)
    def test_a_ripple_of_any_pitch_is_near_a_start(self, waves, phase):
        """Whatever the unit of the way, and without a look at the residual."""
        way = 0.004 * wideband(2000)
        low, high = np.quantile(way, [0.02, 0.98])
        ripple = np.sin(2 * np.pi * waves / (high - low) * way + phase)
        starts = CATALOGUE["cogging"].starts(setting_of(way, own=wideband(2000, 1))._replace(residual=None))
        shares = []
        for N in np.unique(starts[:, 1]):
            pair = np.column_stack([np.sin(N * way), np.cos(N * way)])
            fitted = pair @ np.linalg.lstsq(pair, ripple, rcond=None)[0]
            shares.append(_size(fitted) / _size(ripple))
        assert max(shares) > 0.7

    def test_thresholds_lie_within_the_signal(self, ordinary):
        low, high = ordinary.argument.min(), ordinary.argument.max()
        widths = CATALOGUE["dead_zone"].starts(ordinary)[:, 0]
        assert np.all((widths > 0) & (widths < max(-low, high)))
        levels = CATALOGUE["overflow"].starts(ordinary)
        assert np.all((levels > low) & (levels < high))

    @pytest.mark.parametrize(
        ("code", "column"),
        [("dead_zone", 1), ("input_polynomial", 2), ("gain_drift", 2), ("bilinear_input", 1)],
    )
    def test_a_signal_that_works_elsewhere_gives_two_levels_to_begin_with(self, code, column):
        signal, own, u = wideband(), wideband(seed=1), wideband(seed=2)
        u = None if CATALOGUE[code].second == "feed" else u  # which stands in the signal's place
        size = np.std(signal)
        about_zero = CATALOGUE[code].starts(setting_of(signal - signal.mean(), own=own, second=u))[:, column]
        np.testing.assert_allclose(about_zero, 0.01 * size)
        moved = signal - signal.mean() + 2 * size
        at_input = {"own": moved if CATALOGUE[code].input_port and code != "bilinear_input" else own}
        levels = np.unique(CATALOGUE[code].starts(setting_of(moved, second=u, **at_input))[:, column])
        np.testing.assert_allclose(levels, [0.01 * size, 2 * size])

    def test_the_reference_of_another_signal_starts_at_its_mean(self, ordinary):
        for code in ("coupling", "temperature_gain"):
            starts = CATALOGUE[code].starts(ordinary)
            np.testing.assert_allclose(starts[:, 1], np.mean(ordinary.second))

    def test_a_dead_zone_starts_about_zero_only_where_zero_is_near(self):
        signal = wideband()
        far = CATALOGUE["dead_zone"].starts(setting_of(500.0 + signal))
        np.testing.assert_allclose(far[:, 1], np.mean(500.0 + signal))
        valve = signal - signal.min()  # a command that is never negative
        near = CATALOGUE["dead_zone"].starts(setting_of(valve))
        np.testing.assert_allclose(np.unique(near[:, 1]), [0.01 * np.std(valve), np.mean(valve)])

    @pytest.mark.parametrize(
        "shape",
        [
            lambda t: 1 - np.exp(-t / 0.05),
            lambda t: 1 - np.exp(-t / 0.3),
            lambda t: t,
            lambda t: np.sqrt(t),
            lambda t: np.sin(np.pi * t),
            lambda t: 1 - np.cos(np.pi * t),
            lambda t: t**3,
        ],
        ids=["early", "warm-up", "ramp", "root", "half sine", "half cosine", "cube"],
    )
    @pytest.mark.parametrize("length", [0.5, 300.0])
    def test_an_additive_drift_follows_any_slow_shape(self, shape, length):
        n = 400
        t = np.linspace(0, 1, n)
        wanted = shape(t)
        setting = setting_of(np.cos(20 * t), dt=length / n)
        drift = CATALOGUE["additive_drift"]

        def left(theta):
            return drift.transform(np.zeros(n), None, setting.dt, theta, setting.first) - wanted

        bounds = [[p.lower for p in drift.parameters], [p.upper for p in drift.parameters]]
        best = min(
            least_squares(left, start, bounds=bounds, x_scale="jac", max_nfev=25).cost
            for start in drift.starts(setting)
        )
        assert np.sqrt(2 * best) < 0.035 * np.linalg.norm(wanted)

    @pytest.mark.parametrize("effect", [e for e in TRANSFORMS if e.code != "stuck_sensor"], ids=by_code)
    def test_a_transform_starts_with_a_change_of_ordinary_size(self, effect):
        signal = wideband()
        setting = setting_of(signal, second=wideband(seed=2))
        for theta in effect.starts(setting):
            changed = effect.transform(signal, setting.second, DT, theta, setting.first)
            assert 0.001 < _size(changed - signal) / _size(signal) < 1.5

    @given(w=st.floats(2.0, 150.0), phase=st.floats(0, 6))
    @settings(max_examples=20)
    def test_a_line_in_the_residual_gives_its_frequency(self, w, phase):
        signal = wideband(2000)
        t = np.arange(2000) * DT
        noise = 0.2 * np.random.default_rng(0).normal(size=2000)
        residual = np.sin(w * t + phase) + noise
        starts = CATALOGUE["periodic_disturbance"].starts(setting_of(signal, residual=residual))
        assert np.min(np.abs(starts[:, 1] - w)) < 0.5 * 2 * np.pi / t[-1]

    @pytest.mark.parametrize("waves", [6, 17])
    def test_a_ripple_in_the_residual_gives_its_wave_number(self, waves):
        angle = 3 * wideband(2000)
        residual = np.sin(waves * angle + 1.0) + 0.3 * np.random.default_rng(0).normal(size=2000)
        starts = CATALOGUE["cogging"].starts(setting_of(angle, own=wideband(2000, 1), residual=residual))
        assert waves in starts[:, 1]

    @pytest.mark.parametrize("pitch", [24.0, 7.3])
    def test_a_length_does_not_come_round_after_a_turn(self, pitch):
        """A motor of 24 mm pitch goes along 130 mm: no whole number of radians."""
        way = 65.0 * wideband(2000) / np.abs(wideband(2000)).max()
        residual = np.sin(2 * np.pi / pitch * way + 1.0) + 0.3 * np.random.default_rng(0).normal(size=2000)
        shown = setting_of(way, own=wideband(2000, 1), residual=residual)._replace(turns=False)
        starts = CATALOGUE["cogging"].starts(shown)
        assert np.min(np.abs(starts[:, 1] - 2 * np.pi / pitch)) < 0.25 * 2 * np.pi / np.ptp(way)
        assert starts[:, 1].min() >= 4 * np.pi / np.ptp(way) * (1 - 1e-9)
        assert CATALOGUE["cogging"].limits(shown)[1, 0] == pytest.approx(4 * np.pi / np.ptp(way), rel=0.1)

    def test_the_step_of_a_coarse_sensor_is_read_off_its_values(self):
        signal = wideband()
        residual = 0.25 * np.round((signal + 0.01) / 0.25) - signal
        starts = CATALOGUE["quantisation"].starts(setting_of(signal, residual=residual))
        np.testing.assert_allclose(starts[0], 0.25, rtol=1e-4)

    def test_a_standstill_of_the_sensor_is_found(self):
        signal = wideband()
        shown = transformed("stuck_sensor", signal, [4.0, 1.5, 0.0])
        found, n_tried = CATALOGUE["stuck_sensor"].scan(setting_of(signal), shown - signal)
        assert n_tried > signal.size
        begin, duration, _ = found[0]
        assert begin == pytest.approx(4.0, abs=0.02)
        assert begin + duration == pytest.approx(5.5, abs=0.02)

    @pytest.mark.parametrize("length", [7, 19, 53])
    def test_both_ends_of_a_stuck_stretch_are_found_to_the_sample(self, length):
        rng = np.random.default_rng(length)
        signal = np.cumsum(rng.normal(size=1000))
        shown = signal.copy()
        shown[400 : 400 + length] = signal[400]
        found, _ = CATALOGUE["stuck_sensor"].scan(setting_of(signal), shown - signal)
        np.testing.assert_array_equal(transformed("stuck_sensor", signal, found[0]), shown)

    def test_a_line_that_noise_with_a_memory_hides_is_seen_in_its_innovations(self):
        rng = np.random.default_rng(0)
        white = rng.normal(size=1200) + 0.4 * np.sin(30.0 * DT * np.arange(1200))
        setting = setting_of(wideband(), residual=lfilter([1.0], [1.0, -0.99], white))
        blind, clear = (lines_in_time(s, 1) for s in (setting, setting._replace(innovations=white)))
        assert blind < 10.0
        assert clear == pytest.approx([30.0], abs=0.3)

    def test_repeats_to_the_last_digit_tell_when_and_how_far_off(self):
        signal = wideband()
        noise = 0.1 * np.random.default_rng(0).normal(size=signal.size)
        measured = signal + noise
        measured[300:321] = measured[300]
        setting = setting_of(signal, residual=measured - signal)._replace(elapsed=DT * np.arange(40, 1240))
        effect = CATALOGUE["stuck_sensor"]
        rows, n_tried = effect.scan(setting, setting.residual)
        assert n_tried == 1
        assert rows[0] == pytest.approx([340 * DT, 21 * DT, noise[300]])
        low, high = effect.limits(setting).T
        assert np.all(low[:2] == high[:2])
        assert low[2] < noise[300] < high[2]
        # with noise of its own a reading is that of the signal, at a time that is searched for
        *_, off = effect.limits(setting._replace(residual=noise))
        assert off.tolist() == [0.0, 0.0]

    def test_a_short_hold_is_found_though_all_but_its_end_shows_little(self):
        """Eight samples, of which the last three are a hundred times the noise off and the others a few."""
        noise = 0.01 * np.random.default_rng(4).normal(size=1000)
        away = [0.0, 0.05, 0.1, 0.12, 0.1, 0.8, 1.7, 2.6]
        before, after = 0.3 * np.sin(0.02 * np.arange(500)), 2.6 + np.sin(0.02 * np.arange(492))
        signal = np.concatenate([before, before[-1] + away, before[-1] + after])
        shown = np.concatenate([signal[:500], np.full(8, signal[500]), signal[508:]]) + noise
        rows, _ = CATALOGUE["stuck_sensor"].scan(setting_of(signal), shown - signal)
        assert np.min(np.abs(rows[:, 0] - 500 * DT)) < 1.5 * DT

    def test_a_stuck_sensor_is_found_under_noise(self):
        signal = wideband()
        noise = 0.05 * np.std(signal) * np.random.default_rng(3).standard_normal(signal.size)
        shown = transformed("stuck_sensor", signal, [4.0, 0.2, 0.0]) + noise
        begin, duration, _ = CATALOGUE["stuck_sensor"].scan(setting_of(signal), shown - signal)[0][0]
        assert abs(begin - 4.0) < 0.1
        assert abs(duration - 0.2) < 0.1

    def test_a_rare_clip_is_found_under_noise(self):
        signal = wideband()
        level = np.quantile(signal, 0.97)
        noise = 0.02 * np.std(signal) * np.random.default_rng(5).standard_normal(signal.size)
        residual = np.minimum(signal, level) - signal + noise
        found, _ = CATALOGUE["sensor_clip"].scan(setting_of(signal), residual)
        np.testing.assert_allclose(found[2][1], level, atol=0.05 * np.std(signal))

    def test_a_clip_is_found_that_takes_less_than_a_thousandth_of_the_signal(self):
        signal = wideband()
        level = signal.max() - 0.007 * np.std(signal)
        residual = np.minimum(signal, level) - signal
        assert np.sqrt(np.mean(residual**2)) < 1e-3 * np.std(signal)
        found, _ = CATALOGUE["sensor_clip"].scan(setting_of(signal), residual)
        assert any(low < signal.min() and abs(high - level) < 0.02 * np.std(signal) for low, high in found)

    def test_a_rim_that_the_level_seldom_reaches_has_a_start(self):
        level = wideband(4000)
        rims = CATALOGUE["overflow"].starts(setting_of(level))[:, 0]
        assert np.any((rims > np.quantile(level, 0.998)) & (rims < level.max()))

    @pytest.mark.parametrize("offset", [0.0, 40.0])
    @pytest.mark.parametrize("step", [0.21, 0.013])
    def test_steps_under_noise_are_found_by_trying_all(self, offset, step):
        signal = wideband() + offset
        step = step * np.std(signal)
        noise = 0.4 * step * np.random.default_rng(4).standard_normal(signal.size)
        residual = step * np.round(signal / step) - signal + noise
        found, n_tried = CATALOGUE["quantisation"].scan(setting_of(signal), residual)
        assert n_tried > 50
        np.testing.assert_allclose(found[0], step, rtol=0.01)

    @pytest.mark.parametrize("memory", [0.0, 0.9])
    def test_steps_far_below_noise_with_a_memory_are_found_as_without(self, memory):
        """Innovations of five steps; with a memory of 0.9 the noise itself is of eleven."""
        rng = np.random.default_rng(0)
        signal = 10.0 + 0.02 * np.cumsum(lfilter([1.0], [1.0, -0.9], rng.normal(size=4000)))
        noise = lfilter([1.0], [1.0, -memory], 0.25 * rng.normal(size=4000))
        residual = 0.05 * np.round(signal / 0.05) - signal + noise
        found, _ = CATALOGUE["quantisation"].scan(setting_of(signal), residual)
        assert np.min(np.abs(found[:, 0] - 0.05)) < 1e-4

    def test_no_limit_is_told_by_what_lies_between_two_sessions(self):
        signal = np.concatenate([np.sin(np.arange(200.0) / 20), 100.0 + np.sin(np.arange(200.0) / 20)])
        limits = CATALOGUE["rate_limit"].starts(setting_of(signal, first=[0, 200]))[:, 0]
        fastest = 1.0 / 20 / DT
        assert np.any((0.8 * fastest < limits) & (limits < fastest))
        assert limits.max() < 10 * fastest

    def test_a_limit_that_acts_within_one_sample_is_among_the_starts(self):
        signal = wideband()
        fastest = np.abs(np.diff(signal)).max() / DT
        limits, _, of_code = CATALOGUE["rate_limit"].starts(setting_of(signal)).T
        assert limits.min() < fastest < limits.max()
        assert np.all(limits[of_code == 1.0] < fastest)  # a faster one of code changes nothing


def a_magnet(argument, rate, own, second, time, step, z, theta, dz):
    return theta[0] / (1.0 + argument * argument)


def a_magnet_of_arrays(argument, rate, own, second, time, step, z, theta, dz):
    return theta[:1].sum() / (1.0 + argument * argument) + z.size - dz.size


def one_start(setting):
    return np.array([[0.5]])


def twice(signal, second, dt, theta, first):
    return 2.0 * signal


def raising(*arguments):
    raise KeyError("nothing here")


def make(**changes):
    content = {
        "code": "magnet",
        "title": "Magnet",
        "sentence": "A magnet pulls when near.",
        "equation": "a/(1 + x^2)",
        "parameters": (EffectParameter("a", "{port}"),),
        "starts": one_start,
        "force": a_magnet,
    }
    return Effect(**(content | changes))


class TestRegistry:
    def test_a_registered_effect_is_listed_and_can_be_taken_out(self):
        magnet = make()
        register_effect(magnet)
        try:
            assert CATALOGUE["magnet"] is magnet
            assert list_effects()["code"].iloc[-1] == "magnet"
            with pytest.raises(ValueError, match="already holds an effect of code 'magnet'"):
                register_effect(make())
        finally:
            assert unregister_effect("magnet") is magnet
        assert "magnet" not in CATALOGUE

    def test_a_registered_effect_pickles_with_its_content(self):
        again = pickle.loads(pickle.dumps(make()))
        assert again.force is a_magnet
        assert again.parameters == make().parameters

    def test_a_plain_python_force_runs_in_a_simulator(self, oscillator):
        u = np.column_stack([wideband(), np.zeros(1200)])
        run = oscillator.with_effects([placed_on_mass(make(argument="position"), [2.0])]).simulate(u)
        assert np.mean(run) > np.mean(oscillator.simulate(u)) + 0.01

    def test_a_force_may_take_its_arrays_whole(self, oscillator):
        u = np.column_stack([wideband(), np.zeros(1200)])
        runs = [
            oscillator.with_effects([placed_on_mass(make(force=force, argument="position"), [2.0])]).simulate(
                u
            )
            for force in (a_magnet, a_magnet_of_arrays)
        ]
        np.testing.assert_allclose(*runs, rtol=1e-9)

    @pytest.mark.parametrize("effect", FORCES, ids=by_code)
    def test_forces_of_the_catalogue_need_no_arrays_made(self, effect):
        effect.force.compile(FORCE.args)  # raises where it asks its arrays for more than their values

    def test_the_catalogue_itself_stays(self):
        with pytest.raises(ValueError, match="belongs to the package"):
            unregister_effect("gravity")
        with pytest.raises(ValueError, match="No effect 'lorentz' was registered"):
            unregister_effect("lorentz")

    @pytest.mark.parametrize(
        ("changes", "message"),
        [
            ({"code": "two words"}, "code must be"),
            ({"title": " "}, "title must be a text"),
            ({"sentence": None}, "sentence must be a text"),
            ({"force": None}, "needs a force"),
            ({"force": None, "transform": twice, "input_port": False, "output_port": False}, "act nowhere"),
            ({"force": 3}, "force must be callable"),
            ({"starts": None}, "starts must be callable"),
            ({"parameters": ()}, "0 parameters"),
            ({"parameters": (EffectParameter("a", "-", 1.0, 1.0),)}, "lower < upper"),
            ({"parameters": (("a", "-", 0.0, 1.0),)}, "must be EffectParameter"),
            ({"parameters": (EffectParameter("a", "-", 0.0, 1.0, at_input=2.0),)}, "outside its bounds"),
            ({"argument": "velocity"}, "argument must be one of"),
            ({"second": "state"}, "second must be one of"),
            ({"amplitude": 1}, "amplitude must index"),
            ({"begin": 1}, "begin must index"),
            ({"power": 3.0}, r"power must be Power\(exponent, odd\)"),
            ({"form": 1}, "form must index"),
            ({"choice": 1}, "choice must index"),
            ({"choice": 0}, "parameter 'a' has no finite bounds"),
            ({"reach": -1}, "reach must index"),
            ({"phase": 2}, "phase must index"),
            ({"references": [0]}, "references must be a tuple of indices of its 1 parameters"),
            ({"references": (1,)}, "references must be a tuple of indices"),
            ({"instants": (0,)}, "instants are two indices or none"),
            ({"levels": (0,)}, "levels are two indices or none"),
            ({"met_on": "friction"}, "met_on must be one of"),
            ({"met_at": "state"}, "met_at must be None, 'input' or 'output'"),
            ({"n_memory": 99}, "n_memory must lie"),
            ({"valleys": -1}, "valleys counts the values tried"),
            ({"force": raising}, "force raised KeyError"),
            ({"starts": raising}, "starts raised KeyError"),
            ({"starts": lambda s: np.ones((2, 3))}, r"returned shape \(2, 3\)"),
            ({"limits": 3.0}, "limits must be callable"),
            ({"limits": lambda s: np.ones(2)}, r"limits\(setting\) returned shape \(2,\)"),
            ({"parameters": (EffectParameter("a", "-", 1.0),)}, "outside its bounds"),
            ({"force": lambda *a: np.inf}, "force returned inf"),
            ({"n_memory": 1}, "force left dz"),
            ({"transform": lambda signal, *a: signal[:-1]}, r"transform returned shape \(63,\)"),
            ({"transform": lambda signal, *a: signal.__imul__(2.0)}, "transform changed its signal"),
            ({"held": lambda signal, *a: (signal, signal[:-1])}, r"held returned shape \(63,\)"),
            ({"curved": lambda signal, *a: (signal, signal, signal[:-1])}, r"curved returned shape \(63,\)"),
            ({"curved": 1.0}, "curved must be callable"),
            ({"acts_in": lambda theta: ((1.0, -1.0),)}, r"acts_in returned \[\[1.0, -1.0\]\]"),
            ({"acts_in": lambda theta: (theta[0], np.inf)}, "acts_in returned"),
            ({"acts_in": raising}, "acts_in raised KeyError"),
            (
                {"scan": lambda setting, residual: (np.ones((5, 3)), 5)},
                r"scan returned rows of shape \(5, 3\)",
            ),
            ({"scan": lambda setting, residual: np.ones((5, 1))}, "scan raised"),
        ],
    )
    def test_a_malformed_entry_is_refused_with_a_reason(self, changes, message):
        with pytest.raises(ValueError, match=message):
            register_effect(make(**changes))
        assert "magnet" not in CATALOGUE

    @pytest.mark.parametrize("effect", CATALOGUE.values(), ids=by_code)
    def test_what_is_asked_of_entries_holds_for_the_catalogue(self, effect):
        _check_fields(effect)
        _check_trial(effect)

    def test_only_effects_are_registered(self):
        with pytest.raises(TypeError, match="must be an Effect, got str"):
            register_effect("magnet")

    def test_an_effect_without_starts_can_be_registered(self):
        register_effect(make(starts=no_start))
        unregister_effect("magnet")

    def test_the_list_holds_every_effect_once(self):
        table = list_effects()
        assert table["code"].is_unique
        assert set(table["code"]) == set(CATALOGUE)
        assert table.notna().all().all()


class TestGainThatDrifts:
    def test_a_time_constant_of_which_only_a_straight_line_shows_has_an_end(self):
        setting = setting_of(np.sin(np.arange(500.0)))
        longest = CATALOGUE["gain_drift"].limits(setting)[1, 1]
        assert longest == pytest.approx(30.0 * 500 * DT)
        signal = np.ones(500)
        gained = transformed("gain_drift", signal, [1.0, longest, 0.0]) - signal
        line = np.arange(500) * DT / longest
        assert np.max(np.abs(gained - line)) < 0.02 * line[-1]
        assert np.all(np.isinf(CATALOGUE["gain_drift"].limits(setting)[[0, 2]]))

    def test_one_that_is_over_at_once_is_another_gain(self):
        setting = setting_of(np.sin(np.arange(500.0)))
        shortest = CATALOGUE["gain_drift"].limits(setting)[1, 0]
        gained = transformed("gain_drift", np.ones(500), [1.0, shortest, 0.0]) - 1.0
        left = 1.0 - gained
        assert left[:17].min() > 0.3  # where it is drawn to the step that a gain of its own has
        assert left[100:].max() < 0.003
