"""A simulator in a Functional Mock-up Unit, run through FMPy."""

from collections.abc import Mapping, Sequence
from functools import lru_cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from narx_sklearn.discrepancy.simulators.ode import check_period, describe
from narx_sklearn.discrepancy.simulators.simulator import Signal
from narx_sklearn.discrepancy.surrogates.blackbox import CallableSimulator

NUMBERS = ("Real", "Float64", "Float32")


class FMUSimulator(CallableSimulator):
    """Simulate a Functional Mock-up Unit (FMI 1, 2 or 3) as an engineer exported it.

    Effects at inputs and outputs act on what goes into it and comes out of it; for effects at state
    equations and for runs from other initial states call `identified` first, as of every black box.

    Parameters
    ----------
    path : str or Path
        The ``.fmu`` file.
    dt : float
        Sampling period, s; communication steps are as long.
    inputs, outputs : sequence of str, default=None
        Variables of the unit, in the order of the data's columns; None: all real ones of that causality.
    parameters : sequence of str or mapping of {str: float or (float, float, float)}, default=None
        Parameters of the unit that may be refitted, with values other than its own where given, and bounds.
        None: all real ones with a start value.
    regressor : NARXRegressor, default=None
        How to identify the twin; see `CallableSimulator`.

    Raises
    ------
    ImportError
        If FMPy is not installed.
    ValueError
        If the unit does not have a variable that is named.

    Notes
    -----
    Co-simulation is used where the unit offers it, and holds inputs between samples; model exchange
    interpolates them linearly.

    Examples
    --------
    >>> from narx_sklearn.discrepancy import FMUSimulator
    >>> sim = FMUSimulator("stage.fmu", dt=0.01, parameters=["damping"])  # doctest: +SKIP
    >>> y = sim.simulate(u)  # doctest: +SKIP
    """

    def __init__(
        self,
        path,
        dt: float,
        *,
        inputs: Sequence[str] | None = None,
        outputs: Sequence[str] | None = None,
        parameters: Sequence[str] | Mapping[str, Any] | None = None,
        regressor=None,
    ):
        self.path = Path(path)
        dt = check_period(dt)
        variables = _variables(self.path)
        columns = {
            causality: _chosen(variables, causality, names)
            for causality, names in (("input", inputs), ("output", outputs))
        }
        if isinstance(parameters, str):
            raise TypeError(f"parameters must be a list of names or a mapping, got {parameters!r}.")
        tunable = _chosen(variables, "parameter", None if parameters is None else list(parameters))
        given = parameters if isinstance(parameters, Mapping) else {}
        names = {word: tuple(v.name for v in chosen) for word, chosen in columns.items()}
        super().__init__(
            partial(_run_unit, str(self.path), dt, names["input"], names["output"]),
            dt,
            {_label(v): given.get(v.name, float(v.start or 0.0)) for v in tunable},
            [_label(v) for v in columns["input"]],
            [_label(v) for v in columns["output"]],
            regressor=regressor,
        )

    def __repr__(self) -> str:
        return describe(self, f"FMUSimulator of {self.path.name}, dt={self.dt:g} s")


def _fmpy():
    try:
        import fmpy
    except ImportError as error:
        raise ImportError(
            'Simulating an FMU needs FMPy; install it with: pip install "narx-sklearn[fmu]"'
        ) from error
    return fmpy


def _variables(path: Path) -> list:
    """Return the real variables of a unit."""
    if not path.is_file():
        raise ValueError(f"There is no file {str(path)!r}; pass the path of an .fmu file.")
    return [v for v in _fmpy().read_model_description(str(path)).modelVariables if v.type in NUMBERS]


def _chosen(variables: list, causality: str, names: Sequence[str] | None) -> list:
    """Return the named variables of one causality, or all of it."""
    known = {v.name: v for v in variables if v.causality == causality}
    if names is None:
        return [v for v in known.values() if causality != "parameter" or v.start is not None]
    unknown = [name for name in names if name not in known]
    if unknown:
        raise ValueError(f"The unit has no real {causality} {unknown}; it has {list(known)}.")
    return [known[name] for name in names]


def _label(variable) -> str:
    return str(Signal(variable.name, variable.unit or ""))


@lru_cache(maxsize=8)
def _unpacked(path: str, modified: float) -> TemporaryDirectory:
    """Unpack a unit once; the folder is removed with the last reference."""
    folder = TemporaryDirectory(prefix="narx_sklearn_fmu_")
    _fmpy().extract(path, unzipdir=folder.name)
    return folder


def _run_unit(path, dt, inputs, outputs, u, parameters) -> np.ndarray:
    """Return the outputs of a unit, shape (n_samples, n_outputs)."""
    time = dt * np.arange(u.shape[0])
    columns = np.zeros(time.size, dtype=[("time", float), *((name, float) for name in inputs)])
    columns["time"] = time
    for name, column in zip(inputs, u.T, strict=True):
        columns[name] = column
    folder = _unpacked(path, Path(path).stat().st_mtime)
    result = _fmpy().simulate_fmu(
        folder.name,
        stop_time=time[-1],
        output_interval=dt,
        step_size=dt,
        start_values=parameters,
        input=columns if inputs else None,
        output=list(outputs),
    )
    answer = np.column_stack([result[name] for name in outputs])
    # rounding of the stop time may add or drop the last sample
    return np.column_stack([np.interp(time, result["time"], column) for column in answer.T])
