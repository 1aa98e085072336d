"""What a fetcher and a ``make_*`` function hand back."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import pandas as pd

__all__ = ["Benchmark", "PlantTruth", "SyntheticPlant"]

Parts = pd.DataFrame | Mapping[str, pd.DataFrame]


@dataclass(frozen=True, repr=False)
class Benchmark:
    """Hold a recording in its official split.

    Columns are named ``name [unit]``; ``[x?]`` marks a unit that the source does not state.

    Attributes
    ----------
    name : str
        Short name of the data set.
    train, test : DataFrame, or mapping of str to DataFrame
        One frame where the benchmark has one such part, a mapping of named frames where it has
        several. ``train_parts`` and ``test_parts`` are always mappings.
    input : list of str
        Columns of the inputs: ``X = data.train[data.input]``.
    output : str or list of str
        Column of the output (a list where there are several): ``y = data.train[data.output]``.
    sampling_period : float or None
        In seconds. None where the source states none, or where the points have no time.
    n_init : int
        First samples of each test part that may be used to set the state of a model and are not scored.
    licence : str
        Terms of the data and of the public copy, as far as they are stated.
    source : tuple of str
        Addresses of the files.
    DESCR : str
        What was measured, what is known of the physics, how the data are split, which traps they hold.
    references : tuple of str
        Where the data and the quoted figures were published.
    constants : mapping of str to float
        Published constants of the system, in the units of their keys. Empty where none are known.
    """

    name: str
    train: Parts
    test: Parts
    input: list[str]
    output: str | list[str]
    sampling_period: float | None
    n_init: int
    licence: str
    source: tuple[str, ...]
    DESCR: str
    references: tuple[str, ...]
    constants: Mapping[str, float] = field(default_factory=dict)

    @property
    def train_parts(self) -> Mapping[str, pd.DataFrame]:
        """Training frames by name; ``{"train": frame}`` where there is one."""
        return _as_parts(self.train, "train")

    @property
    def test_parts(self) -> Mapping[str, pd.DataFrame]:
        """Test frames by name; ``{"test": frame}`` where there is one."""
        return _as_parts(self.test, "test")

    def __repr__(self) -> str:
        period = "none" if self.sampling_period is None else f"{self.sampling_period:g} s"
        return (
            f"Benchmark({self.name!r}, train: {_sizes(self.train_parts)}, test: {_sizes(self.test_parts)}, "
            f"input: {self.input}, output: {self.output!r}, sampling_period: {period})"
        )


@dataclass(frozen=True)
class PlantTruth:
    """Hold what is known of a synthetic plant because it was made.

    Attributes
    ----------
    equation : str
        The equations that were integrated, in the symbols of `parameters`.
    parameters : mapping of str to float
        Value of every symbol, SI or the units stated by the function that made the plant.
    y : Series of shape (n_samples,)
        Output without measurement noise.
    states : DataFrame of shape (n_samples, n_states)
        States and hidden signals at the samples.
    """

    equation: str
    parameters: Mapping[str, float]
    y: pd.Series
    states: pd.DataFrame


@dataclass(frozen=True, repr=False)
class SyntheticPlant:
    """Hold a simulated recording with its ground truth.

    Attributes
    ----------
    name : str
        Short name of the plant.
    X : DataFrame of shape (n_samples, n_inputs)
        Inputs, columns named ``name [unit]``.
    y : Series of shape (n_samples,)
        Measured output: the truth plus the noise that was asked for.
    sampling_period : float
        In seconds.
    truth : PlantTruth
        Equations, parameters, noise-free output and hidden states.
    DESCR : str
        What the plant is and what makes it hard.
    """

    name: str
    X: pd.DataFrame
    y: pd.Series
    sampling_period: float
    truth: PlantTruth
    DESCR: str

    def __repr__(self) -> str:
        return (
            f"SyntheticPlant({self.name!r}, {len(self.X)} samples, input: {list(self.X.columns)}, "
            f"output: {self.y.name!r}, sampling_period: {self.sampling_period:g} s)"
        )


def _as_parts(parts: Parts, name: str) -> Mapping[str, pd.DataFrame]:
    return {name: parts} if isinstance(parts, pd.DataFrame) else parts


def _sizes(parts: Mapping[str, pd.DataFrame]) -> str:
    return ", ".join(f"{name} ({len(frame)})" for name, frame in parts.items())
