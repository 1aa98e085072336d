"""How alike effects look under an input, and the input under which they do least, before any measurement."""

from itertools import combinations
from numbers import Integral

import numpy as np
import pandas as pd

from narx_sklearn._validation import finite_rows
from narx_sklearn.discrepancy.designs import fewest_samples, make_designs, read_limits, settled, spliced
from narx_sklearn.discrepancy.experiment import AS_GOOD, LOST, SPLICED, Experiment, chance, lost_in
from narx_sklearn.discrepancy.records.record import read_inputs
from narx_sklearn.discrepancy.settings import read_effects
from narx_sklearn.discrepancy.simulators.simulator import Run, Simulator, Windows
from narx_sklearn.discrepancy.simulators.windows import cut, find_pace, followed_for
from narx_sklearn.discrepancy.tangents import EffectTangents, effect_tangents

RESOLVED = 4.0  # separation, in standard deviations of the noise, at which a pair counts as told apart
VISIBLE = 2 * RESOLVED  # what one at thirty degrees then is apart by


def confusability(
    simulator: Simulator, X, *, effects, noise, n_windows: int = 24
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Tell, before any measurement, which effects an input can show and which look alike under it.

    Parameters
    ----------
    simulator : Simulator
        The simulation as it stands. It starts from rest, all states zero.
    X : array-like or DataFrame of shape (n_samples, n_inputs) or (n_samples,)
        The input that will be used, without gaps: in the order of the simulator's, or a DataFrame with
        columns of their names.
    effects : "catalogue" or list of (str or Effect)
        What might be missing, by code, or effects of your own.
    noise : float or sequence of float
        Standard deviation of the measurement noise, in the output's unit; one value an output, or one.
    n_windows : int, default=24
        Windows with initial states of their own.

    Returns
    -------
    angles : DataFrame
        Angle in degrees between every two effects' columns, after the simulator's own parameters and initial
        states are projected out; near 0 they cannot be told apart. What does not show has none.
    visible : DataFrame
        For each effect ``separation``, how far an ordinary size of it moves the output, in standard
        deviations of the noise; and ``smallest_share``, its smallest size that is found with good chance, as
        a share of an ordinary size: infinite for what the simulator's own parameters do as well.

    Raises
    ------
    TypeError
        If ``simulator`` is none, or ``effects`` no list.
    ValueError
        If ``X``, ``noise``, ``n_windows`` or an effect does not fit, or the simulation leaves the finite
        range.

    See Also
    --------
    design_input : The input under which effects look least alike.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.discrepancy import ODESimulator, confusability
    >>> sim = ODESimulator(
    ...     lambda x, u, p: (x[1], p[0] * u[0] - p[1] * x[1]), dt=0.02,
    ...     parameters={"gain": 2.0, "damping": 1.0}, states=["position", "velocity"], inputs=["drive"],
    ... )
    >>> u = np.repeat(np.random.default_rng(0).normal(size=20), 20)
    >>> angles, visible = confusability(sim, u, effects=["coulomb_friction", "viscous_damping"], noise=1e-3)
    >>> float(visible.loc["viscous_damping at state:1 (velocity)", "smallest_share"])  # damping does the same
    inf
    """
    _check_simulator(simulator)
    chosen = read_effects(effects)
    if not isinstance(n_windows, Integral) or isinstance(n_windows, bool) or n_windows < 1:
        raise ValueError(f"n_windows is {n_windows!r}; wanted is an integer of at least 1.")
    if not simulator.inputs:  # a trace that waits for the inputs that led to it
        simulator = simulator.identified(X)
    u = read_inputs(X, simulator)
    gaps = np.flatnonzero(~finite_rows(u))
    if gaps.size:
        raise ValueError(
            f"X is NaN at {gaps.size} samples, first at {gaps[0]}; wanted is the input that will be used, "
            "without gaps."
        )
    least = fewest_samples(simulator)
    if len(u) < least:
        raise ValueError(
            f"X has {len(u)} samples, too few once the simulator's initial states and parameters are "
            f"refitted. Pass at least {least}."
        )
    sigma = _read_noise(noise, simulator)
    simulator = simulator.identified(u)
    run = _free_run(simulator, u, simulator.x0)
    if run.failed >= 0 or not np.isfinite(run.y).all():
        k = int(np.argmin(finite_rows(run.y)))
        raise ValueError(
            f"X drives the simulation out of the finite range at sample {k}. Pass a smaller or shorter "
            "input, or put the controller into the simulator."
        )
    windows = cut([(slice(0, len(u)), 0)], max(8, len(u) // n_windows), 4)
    found = effect_tangents(simulator, u, windows, run.x[windows.first], chosen, sigma)
    length, names = found.length[0], np.array(found.names, dtype=object)
    shown = length > 0
    angles = np.degrees(np.arccos(found.cosine[0][np.ix_(shown, shown)]))
    with np.errstate(divide="ignore"):
        visible = pd.DataFrame(
            {"separation": length, "smallest_share": RESOLVED / length}, index=pd.Index(names, name="effect")
        )
    return pd.DataFrame(angles, index=names[shown], columns=names[shown]), visible


def design_input(
    simulator: Simulator,
    effects,
    *,
    amplitude: float,
    n_samples: int,
    noise,
    offset: float = 0.0,
    rate: float | None = None,
    column: int = 0,
    held=None,
    random_state=None,
    n_jobs: int | None = None,
) -> Experiment:
    r"""Design, before any measurement, the input under which effects look least alike.

    Each effect has a size that is the same under all designs: an ordinary one, but no larger than what the
    design that shows it best shows at eight standard deviations of the noise. Two of them are as far apart as
    the smaller goes beyond what the other can do at any size,

    .. math:: d_{ij} = \min(l_i, l_j) \sin \varphi_{ij},

    with the lengths and the angle of their tangents once the simulator's own parameters and the initial state
    are projected out. The design wins whose worst pair is most likely told apart, a chance of which two
    decimals count; among designs as good the next worst decides, and so on, for some pairs no input
    separates; last the distance of the worst. The best are tried in halves with one another too.

    Parameters
    ----------
    simulator : Simulator
        The simulation as it stands.
    effects : "catalogue" or list of (str or Effect)
        What might be missing, by code, or effects of your own; each at every place where it could act. Of
        several effects the places of one are not told apart from each other.
    amplitude : float
        Largest departure of the input from ``offset``, in its unit.
    n_samples : int
        Length of the experiment.
    noise : float or sequence of float
        Standard deviation of the measurement noise, in the output's unit; one value an output, or one.
    offset : float, default=0.0
        Middle of the input. The experiment begins there, where the simulation rests if it does.
    rate : float, optional
        Largest change of the input in one second.
    column : int, default=0
        Which input is moved.
    held : array-like of shape (n_inputs,), optional
        Where the other inputs rest; zero by default.
    random_state : int, RandomState instance or None, default=None
        Seed of the designs.
    n_jobs : int, optional
        Threads over effects.

    Returns
    -------
    Experiment
        The input ``u``, what it is in words, how far it separates the worst pair, and the ``table`` of all
        designs under which the simulation stays within the finite range.

    Raises
    ------
    TypeError
        If ``simulator`` is none, a limit is no number, or ``effects`` no list.
    ValueError
        If a limit, ``noise``, ``held`` or an effect does not fit, there are fewer than two effects to tell
        apart, or the simulation leaves the finite range under every design.

    See Also
    --------
    confusability : How alike effects look under an input of your own.

    Examples
    --------
    >>> from narx_sklearn.discrepancy import ODESimulator, design_input
    >>> sim = ODESimulator(
    ...     lambda x, u, p: (x[1], p[0] * u[0] - p[1] * x[1]), dt=0.02,
    ...     parameters={"gain": 2.0, "damping": 1.0}, states=["position", "velocity"], inputs=["drive"],
    ... )
    >>> plan = design_input(
    ...     sim, ["coulomb_friction", "dead_zone"],
    ...     amplitude=5.0, rate=20.0, n_samples=400, noise=1e-3, random_state=0,
    ... )
    >>> plan.u.shape, plan.separation > 2  # standard deviations of the noise
    ((400, 1), True)
    """
    _check_simulator(simulator)
    chosen = read_effects(effects)
    if getattr(simulator, "twin_", simulator) is None:
        raise ValueError(
            f"{type(simulator).__name__} has no twin yet, whose states the effects act on. Pass "
            "simulator.identified(X), with inputs X such as the experiment may have."
        )
    limits = read_limits(simulator, amplitude, n_samples, offset=offset, rate=rate, column=column)
    sigma = _read_noise(noise, simulator)
    base = _read_held(held, simulator)
    base[limits.column] = limits.offset
    x0 = settled(simulator, base, limits.n_samples)
    designs = [
        (kind, u)
        for kind, u in make_designs(simulator, x0, base, limits, random_state)
        if np.isfinite(_free_run(simulator, u, x0).y).all()
    ]
    with np.errstate(all="ignore"):
        reach = followed_for(simulator, find_pace(simulator, x0[None], base[None]))
    if not designs or n_samples > LOST * reach:
        raise ValueError(lost_in(n_samples))

    def tried(some: list[tuple[str, np.ndarray]]) -> EffectTangents:
        n = limits.n_samples
        windows = Windows.whole([slice(k * n, (k + 1) * n) for k in range(len(some))])
        u = np.concatenate([u for _, u in some])
        starts = np.tile(x0, (len(some), 1))
        return effect_tangents(simulator, u, windows, starts, chosen, sigma, apart=True, n_jobs=n_jobs)

    found = tried(designs)
    if distances := _distances(found):
        best = _by_goodness(distances)[: -SPLICED - 1 : -1]
        together = [
            (kind, u)
            for kind, u in spliced([designs[k] for k in best], limits, simulator.dt)
            if np.isfinite(_free_run(simulator, u, x0).y).all()
        ]
        if together:
            designs = designs + together
            found = tried(designs)  # anew: sizes and shapes are the same under all
            distances = _distances(found)
    if not distances:
        raise ValueError(
            f"effects has fewer than two to tell apart at any place of the simulator: {found.names}. Pass "
            "more of them."
        )
    apart = np.array(list(distances.values())).T  # (n_designs, n_pairs)
    table = pd.DataFrame(
        {
            "design": [kind for kind, _ in designs],
            "separation": apart.min(axis=1),
            "chance": chance(apart.min(axis=1)),
            "expected": chance(apart).sum(axis=1).round(AS_GOOD),
        }
        | distances
    )
    chosen_one = _by_goodness(distances)[-1]
    kind, u = designs[chosen_one]
    separation = float(table["separation"][chosen_one])
    table = table.sort_values("separation", ascending=False, ignore_index=True)
    return Experiment(u, kind, separation, float(chance(separation)), table, tuple(distances))


def _by_goodness(distances: dict[str, np.ndarray]) -> list[int]:
    """Return designs, the best last: its pair least likely told apart is likelier so, then the next."""
    apart = np.array(list(distances.values())).T  # (n_designs, n_pairs)
    likely = np.round(chance(apart), AS_GOOD)
    # of those as good the first is the last here
    return sorted(range(len(apart)), key=lambda k: (*np.sort(likely[k]), apart[k].min(), -k))


def _distances(found: EffectTangents) -> dict[str, np.ndarray]:
    """Return for each pair of effects how far apart they are under each design, (n_designs,)."""
    length, names = found.length, found.names
    size = VISIBLE / np.maximum(length.max(axis=0, initial=0.0), VISIBLE)
    length, sine = length * size, np.sqrt(1 - found.cosine**2)
    codes = [placed.effect.code for placed in found.placed]
    return {
        f"{names[i]} / {names[j]}": np.minimum(length[:, i], length[:, j]) * sine[:, i, j]
        for i, j in combinations(range(len(names)), 2)
        if codes[i] != codes[j] or len(set(codes)) == 1
    }


def _free_run(simulator: Simulator, u: np.ndarray, x0: np.ndarray) -> Run:
    return simulator.run(u, Windows.whole([slice(0, len(u))]), x0[None])


def _check_simulator(simulator) -> None:
    if not isinstance(simulator, Simulator):
        raise TypeError(
            f"simulator is a {type(simulator).__name__}; wanted is a Simulator such as ODESimulator(...)."
        )


def _read_noise(noise, simulator: Simulator) -> np.ndarray:
    """Return the standard deviation of each output's noise."""
    n = len(simulator.outputs)
    try:
        sigma = np.asarray(noise, dtype=float)
    except (TypeError, ValueError) as error:
        raise TypeError(f"noise is {noise!r}; wanted is a number, or one an output.") from error
    if sigma.shape not in ((), (n,)) or not (np.isfinite(sigma) & (sigma > 0)).all():
        raise ValueError(
            f"noise is {noise!r}; wanted is the standard deviation of the measurement noise, positive and "
            f"finite: one number, or one for each of {[str(s) for s in simulator.outputs]}."
        )
    return np.array(np.broadcast_to(sigma, n))


def _read_held(held, simulator: Simulator) -> np.ndarray:
    """Return where the inputs rest that are not moved."""
    n = len(simulator.inputs)
    base = np.zeros(n) if held is None else np.array(held, dtype=float)
    if base.shape != (n,) or not np.isfinite(base).all():
        raise ValueError(
            f"held is {held!r}; wanted is a finite value for each of {[str(s) for s in simulator.inputs]}."
        )
    return base
