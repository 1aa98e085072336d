"""Measured signals as channels: lags and phi regressors stay inside sessions and out of gaps."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from narx_sklearn.model import Difference, DifferenceSign, FunctionPhi, Play
from narx_sklearn.model.recording import Layout, lay_out

PHI = (
    Difference("u", name="phi1"),
    DifferenceSign("y", name="phi2"),
    Play("u", radius=0.5, name="phi3"),
    FunctionPhi(lambda u, y: u + 10 * y, ["u[k-2]", "y[k]"], name="phi4"),
)
LAYOUT = Layout.of(("y",), ("u",), PHI)


@st.composite
def records(draw):
    """Small records with gaps and sessions."""
    n_samples = draw(st.integers(1, 14))
    values = np.random.default_rng(draw(st.integers(0, 99))).uniform(-2, 2, (n_samples, 2))
    for column in values.T:
        column[draw(st.lists(st.integers(0, n_samples - 1), max_size=3))] = np.nan
    sessions = draw(st.none() | st.lists(st.sampled_from("ab"), min_size=n_samples, max_size=n_samples))
    return values[:, :1], values[:, 1:], sessions


def session_of(sessions, n_samples):
    """Number the sessions by counting changes of the label."""
    if sessions is None:
        return [0] * n_samples
    return np.cumsum([a != b for a, b in zip([sessions[0], *sessions], sessions, strict=False)]).tolist()


@given(records(), st.lists(st.tuples(st.integers(0, 5), st.integers(0, 4)), max_size=4), st.booleans())
def test_rows_are_where_every_lagged_value_is_known_in_the_same_session(record, variables, with_target):
    X, y, sessions = record
    recording = lay_out(LAYOUT, X, y, sessions)
    channels = np.array([c for c, _ in variables], dtype=np.int64)
    lags = np.array([lag for _, lag in variables], dtype=np.int64)
    session = session_of(sessions, len(X))
    longest = max(lags, default=0)
    expected = [
        k
        for k in range(len(X))
        if k >= longest
        and session[k - longest] == session[k]
        and all(np.isfinite(recording.data[k - lag, c]) for c, lag in variables)
        and (not with_target or np.isfinite(y[k, 0]))
    ]
    assert recording.rows(channels, lags, targets=[0] if with_target else ()).tolist() == expected


@given(records())
def test_phi_regressors_are_those_of_each_gapless_piece_alone(record):
    X, y, sessions = record
    data = lay_out(LAYOUT, X, y, sessions).data
    session = session_of(sessions, len(X))
    for channel, phi in enumerate(PHI, start=2):
        sources = [{"y": y, "u": X}[s][:, 0] for s in dict.fromkeys(v.signal for v in phi.arguments)]
        expected = np.full(len(X), np.nan)
        begin = 0
        for k in range(len(X)):
            if k and session[k] != session[k - 1]:
                begin = k
            if not np.isfinite([s[k] for s in sources]).all():
                begin = k + 1
            elif k - begin >= phi.reach:  # its past lies in the piece
                expected[k] = phi.run(*(s[begin : k + 1] for s in sources))[-1]
        np.testing.assert_array_equal(data[:, channel], expected)


def test_lags_longer_than_the_record_leave_no_rows():
    recording = lay_out(LAYOUT, np.array([[1.0], [np.nan], [2.0]]), np.zeros((3, 1)))
    assert recording.rows(np.array([1]), np.array([7])).size == 0
    assert recording.rows(np.array([1]), np.array([3])).size == 0
    assert recording.rows(np.array([1]), np.array([2])).tolist() == [2]


def test_no_variables_are_known_everywhere():
    recording = lay_out(LAYOUT, np.ones((3, 1)), np.ones((3, 1)))
    none = np.zeros(0, dtype=np.int64)
    assert recording.rows(none, none).tolist() == [0, 1, 2]


def test_one_sample_is_a_recording():
    recording = lay_out(LAYOUT, np.array([[2.0]]), np.array([[3.0]]))
    np.testing.assert_array_equal(recording.data, [[3.0, 2.0, np.nan, np.nan, 1.5, np.nan]])
    assert recording.n_samples == 1


def test_label_that_returns_begins_a_new_session():
    recording = lay_out(LAYOUT, np.ones((5, 1)), np.ones((5, 1)), ["a", "a", "b", "a", "a"])
    assert recording.session_start.tolist() == [0, 0, 2, 3, 3]


def test_signals_are_shifted_and_scaled_after_their_phi_regressors_are_formed():
    phi = (Difference("u", name="phi1"), FunctionPhi(np.square, ["y[k]"], name="phi2"))
    layout = Layout.of(("y",), ("u",), phi, origin={"y": 300.0, "u": 1.0}, scale={"y": 2.0, "phi1": 10.0})
    data = lay_out(layout, np.array([[1.0], [4.0]]), np.array([[300.0], [306.0]])).data
    np.testing.assert_array_equal(data, [[0.0, 0.0, np.nan, 90000.0], [3.0, 3.0, 0.3, 93636.0]])


def test_measured_arrays_are_left_as_they_are():
    X, y = np.ones((4, 1)), np.ones((4, 1))
    X.setflags(write=False)
    y.setflags(write=False)
    lay_out(Layout.of(("y",), ("u",), PHI, origin={"y": 1.0}), X, y)
    assert X.sum() == y.sum() == 4.0


def test_one_label_a_sample_is_wanted():
    with pytest.raises(ValueError, match=r"one label a sample, shape \(3,\), got shape \(2,\)"):
        lay_out(LAYOUT, np.ones((3, 1)), np.ones((3, 1)), ["a", "b"])
