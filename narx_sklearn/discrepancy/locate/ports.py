"""Which port: the latent forces of all of them, side by side."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
from joblib import Parallel, delayed
from scipy.stats import t as student

from narx_sklearn.discrepancy.locate.latent_force import Background, LatentForce, background, latent_force
from narx_sklearn.discrepancy.locate.tangent import tangent
from narx_sklearn.discrepancy.placed import Port
from narx_sklearn.discrepancy.simulators.simulator import Run, Simulator, Windows
from narx_sklearn.model.units import rate_of, tidy_unit
from narx_sklearn.physics.effects import PORTS

FEWEST_BLOCKS = 20  # stretches whose log likelihoods are compared in pairs
TIED = 0.05  # a port stays tied with the best until the difference is this improbable
NOTHING = 0.01  # p value, over all ports, above which no port explains more than noise does


def ports_of(simulator: Simulator) -> tuple[Port, ...]:
    """Return every input, state equation and output of a simulator.

    Parameters
    ----------
    simulator : Simulator
        Any.

    Returns
    -------
    tuple of Port
        Inputs first, outputs last.
    """
    return tuple(Port(kind, i) for kind in PORTS for i in range(len(simulator.signals_at(kind))))


def latent_forces(
    simulator: Simulator,
    run: Run,
    u: np.ndarray,
    y: np.ndarray,
    windows: Windows,
    p=None,
    *,
    ports: Sequence[Port] | None = None,
    noise: str = "ar1",
    n_jobs: int | None = None,
) -> tuple[Background, tuple[LatentForce, ...]]:
    """Estimate the latent force at every port of a simulator.

    Parameters
    ----------
    simulator : Simulator
        With parameters refitted to the record.
    run : Run
        Its run over ``windows``.
    u, y : ndarray of shape (n_samples, n_inputs), (n_samples, n_outputs)
        The record; NaN in ``y`` is skipped.
    windows : Windows
        Windows of the run.
    p : ndarray of shape (n_parameters,), optional
        Parameters of the run; the simulator's own when not given.
    ports : sequence of Port, optional
        Where to look; everywhere when not given.
    noise : {"ar1", "white"}, default="ar1"
        Colour of the noise.
    n_jobs : int, optional
        Threads that look at ports.

    Returns
    -------
    tuple of Background and tuple of LatentForce
        Noise alone, and one force a port.
    """
    linear = tangent(simulator, run, u, windows, p)
    residual = y - run.y
    against = background(linear, residual, windows, noise=noise)

    def force_at(port: Port) -> LatentForce:
        own = {"input": u, "output": run.y}.get(port.kind)
        arguments = run.x if own is None else own[:, [port.index]]
        return latent_force(
            linear, residual, windows, port, arguments=arguments, noise=noise, against=against
        )

    everywhere = ports_of(simulator) if ports is None else ports
    forces = Parallel(n_jobs=n_jobs, prefer="threads")(delayed(force_at)(port) for port in everywhere)
    return against, tuple(forces)


def port_table(forces: Sequence[LatentForce], simulator: Simulator, windows: Windows) -> pd.DataFrame:
    """Rank the ports by how well a force there explains the residual.

    Parameters
    ----------
    forces : sequence of LatentForce
        One a port, over the same residual.
    simulator : Simulator
        Gives names and units.
    windows : Windows
        Windows of the run; when there are at least 20, the comparison is made over them, else over equal
        stretches.

    Returns
    -------
    DataFrame
        One row a port, best first: ``kind``, ``index``, ``name``, ``unit`` of the force, ``gain`` and
        ``own_gain`` of log likelihood (nats), ``share`` of the residual's energy, ``p_value`` against noise
        alone (adjusted for the number of ports), ``p_best`` that the port is as good as the best
        (one-sided, paired over the stretches), and ``tied``: among those that may be the place.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.discrepancy import ODESimulator
    >>> from narx_sklearn.discrepancy.locate import latent_forces, port_table
    >>> from narx_sklearn.discrepancy.simulators.simulator import Windows
    >>> def tank(x, u, p):
    ...     return (u[0] - p[0] * x[0],)
    >>> sim = ODESimulator(tank, dt=0.1, parameters={"outflow [1/s]": 0.5}, states=["level [m]"],
    ...                    inputs=["pump [m/s]"])
    >>> rng = np.random.default_rng(0)
    >>> u = np.repeat(rng.normal(size=100), 20)[:, None]
    >>> whole = Windows.whole([slice(0, 2000)])
    >>> y = sim.simulate(np.maximum(u, -0.5)) + 0.01 * rng.normal(size=(2000, 1))
    >>> _, forces = latent_forces(sim, sim.run(u, whole, np.zeros((1, 1))), u, y, whole)
    >>> port_table(forces, sim, whole).loc[0, "kind"]
    'input'
    """
    order = sorted(range(len(forces)), key=lambda i: -forces[i].evidence)
    best = forces[order[0]]
    blocks = _blocks(windows)
    something = len(forces) * min(force.p_value for force in forces) <= NOTHING
    rows = []
    for i in order:
        force = forces[i]
        name, unit = _name(simulator, force.port)
        p_value = min(1.0, len(forces) * force.p_value)
        p_best = _as_good(np.add.reduceat(best.log_likelihood - force.log_likelihood, blocks))
        rows.append(
            {
                "kind": force.port.kind,
                "index": force.port.index,
                "name": name,
                "unit": unit,
                "gain": force.gain,
                "own_gain": force.own_gain,
                "share": force.share,
                "p_value": p_value,
                "p_best": p_best,
                "tied": p_best >= TIED and something,
            }
        )
    return pd.DataFrame(rows)


def _blocks(windows: Windows) -> np.ndarray:
    """Return the first sample of each stretch whose log likelihoods are compared."""
    if windows.count >= FEWEST_BLOCKS:
        return windows.first
    first, last = windows.first[0], windows.last[-1]
    return np.unique(np.linspace(first, last, FEWEST_BLOCKS + 1).astype(int)[:-1])


def _as_good(differences: np.ndarray) -> float:
    """Return the one-sided p value that paired differences have no positive mean."""
    spread = differences.std(ddof=1) / np.sqrt(differences.size)
    if not spread > 0:
        return 1.0
    return float(student.sf(differences.mean() / spread, differences.size - 1))


def _name(simulator: Simulator, port: Port) -> tuple[str, str]:
    signal = simulator.signals_at(port.kind)[port.index]
    if port.kind == "state" and not simulator.discrete:
        return rate_of(signal.name), tidy_unit(f"{signal.unit or 1}/s")
    return signal.name, signal.unit
