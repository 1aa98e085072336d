"""Measured signals laid out for the kernels: channels side by side, sessions and gaps respected."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from narx_sklearn._validation import finite_slices, session_slices
from narx_sklearn.model.phi import Phi


class Layout(NamedTuple):
    """Which signals stand in which channel, and how they are shifted and scaled there."""

    outputs: tuple[str, ...]
    inputs: tuple[str, ...]
    phi: tuple[Phi, ...]
    origin: np.ndarray  # (n_channels,) subtracted; zero for phi regressors
    scale: np.ndarray  # (n_channels,) divided by

    @classmethod
    def of(cls, outputs, inputs, phi, origin=None, scale=None) -> "Layout":
        """Return the layout of the named signals; ``origin`` and ``scale`` map names to numbers."""
        names = (*outputs, *inputs, *(p.name for p in phi))
        at = origin or {}
        by = scale or {}
        return cls(
            tuple(outputs),
            tuple(inputs),
            tuple(phi),
            np.array([at.get(name, 0.0) for name in names], dtype=float),
            np.array([by.get(name, 1.0) for name in names], dtype=float),
        )

    @property
    def channels(self) -> tuple[str, ...]:
        """Names in the order of the channels."""
        return (*self.outputs, *self.inputs, *(str(p.name) for p in self.phi))

    def depends_on_output(self, phi: Phi) -> bool:
        """Tell whether ``phi`` is a function of an output."""
        return bool(phi.signals & set(self.outputs))


class Recording(NamedTuple):
    """Channels of measured data: NaN where a value is missing or not yet defined."""

    data: np.ndarray  # (n_samples, n_channels), C-contiguous
    session_start: np.ndarray  # (n_samples,) int64, first sample of each sample's session

    @property
    def n_samples(self) -> int:
        """Number of samples."""
        return self.data.shape[0]

    def rows(self, channels: np.ndarray, lags: np.ndarray, targets: Sequence[int] = ()) -> np.ndarray:
        """Return the samples at which every lagged variable (and every target) is known.

        Lags never reach across a session's edge or a gap.
        """
        longest = min(int(lags.max(initial=0)), self.n_samples)
        known = np.zeros(self.n_samples, dtype=bool)
        known[longest:] = self.session_start[longest:] == self.session_start[: self.n_samples - longest]
        for target in targets:
            known &= np.isfinite(self.data[:, target])
        for channel in np.unique(channels):
            finite = np.isfinite(self.data[:, channel])
            if finite.all():
                continue
            for lag in lags[channels == channel]:
                known[lag:] &= finite[: max(self.n_samples - lag, 0)]
        return np.flatnonzero(known)


def lay_out(layout: Layout, X: np.ndarray, y: np.ndarray, sessions=None) -> Recording:
    """Return measured inputs ``X`` and outputs ``y`` (2-D) as channels, phi regressors computed."""
    n_samples = X.shape[0]
    pieces = session_slices(sessions, n_samples)
    data = np.empty((n_samples, len(layout.channels)))
    n_outputs, n_inputs = len(layout.outputs), len(layout.inputs)
    data[:, :n_outputs] = y
    data[:, n_outputs : n_outputs + n_inputs] = X
    for i, phi in enumerate(layout.phi):
        data[:, n_outputs + n_inputs + i] = _phi_column(layout, phi, data, pieces)
    shift_and_scale(layout, data)
    start = np.zeros(n_samples, dtype=np.int64)
    for piece in pieces[1:]:
        start[piece] = piece.start
    return Recording(data, start)


def shift_and_scale(layout: Layout, data: np.ndarray) -> None:
    """Bring raw channels, shape (n_samples, n_channels), to the layout's origin and scale, in place."""
    if layout.origin.any():
        data -= layout.origin
    if np.any(layout.scale != 1.0):
        data /= layout.scale


def _phi_column(layout: Layout, phi: Phi, data: np.ndarray, pieces: list[slice]) -> np.ndarray:
    """Return a phi regressor of measured signals; NaN in gaps and where its past is not known."""
    signals = dict.fromkeys(variable.signal for variable in phi.arguments)
    sources = [data[:, layout.channels.index(signal)] for signal in signals]
    finite = np.all([np.isfinite(source) for source in sources], axis=0)
    values = np.full(data.shape[0], np.nan)
    for piece in finite_slices(pieces, finite):
        values[piece] = phi.run(*(source[piece] for source in sources))
        values[piece.start : min(piece.start + phi.reach, piece.stop)] = np.nan
    return values
