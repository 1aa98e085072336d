"""Kernels of the latent force: Kalman filter and smoother over windows, and responses to known forces.

    dx[k+1] = A[k] dx[k] + g[k] w[k]          deviation of the states, free at the start of every window
    w[k+1]  = phi w[k] + noise                the unknown signal at the port, variance w_var
    v[k+1]  = diag(rho) v[k] + noise          coloured noise of each output, variance s (left out at rho = 0)
    b[k]    = C[k] dx[k] + d[k] w[k] + v[k] + white noise of variance r

The state is (dx, w, v). ``rho``, ``s`` and ``r`` have shape (n_outputs,); where rho is 0 for some outputs
alone, their v is new at every sample. ``seam`` says what follows a sample: 0 the next sample of the window;
n > 0 a new window, n samples later; -1 a new session.
"""

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def state_size(n_states, n_outputs, rho):
    """Return the size of (dx, w, v)."""
    return n_states + 1 + (n_outputs if np.any(rho > 0.0) else 0)


@njit(cache=True, nogil=True)
def _begin(P, start, w_var, s):
    """Write the covariance with which a session begins."""
    n = start.size
    P[:] = 0.0
    for i in range(n):
        P[i, i] = start[i]
    P[n, n] = w_var
    for i in range(n + 1, P.shape[0]):
        P[i, i] = s[i - n - 1]


@njit(cache=True, nogil=True)
def _transition(F, A, g, phi, rho, seam):
    """Write the transition to the next sample; what a seam forgets is zero."""
    n = A.shape[0]
    F[:] = 0.0
    if seam < 0:
        return
    length = 1 if seam == 0 else seam
    if seam == 0:
        for i in range(n):
            for j in range(n):
                F[i, j] = A[i, j]
            F[i, n] = g[i]
    F[n, n] = phi**length
    for i in range(n + 1, F.shape[0]):
        F[i, i] = rho[i - n - 1] ** length


@njit(cache=True, nogil=True)
def _added_variance(Q, F, start, w_var, s, seam):
    """Write the variances of the process noise of one transition."""
    n = start.size
    for i in range(n):
        Q[i] = 0.0 if seam == 0 else start[i]
    Q[n] = w_var * (1.0 - F[n, n] ** 2)
    for i in range(n + 1, Q.size):
        Q[i] = s[i - n - 1] * (1.0 - F[i, i] ** 2)


@njit(cache=True, nogil=True)
def _observe(h, C, d, output):
    """Write the row of the observation matrix of one output."""
    n = C.shape[1]
    h[:] = 0.0
    for i in range(n):
        h[i] = C[output, i]
    h[n] = d[output]
    if h.size > n + 1:
        h[n + 1 + output] = 1.0


@njit(cache=True, nogil=True)
def filter_windows(A, g, C, d, seam, phi, w_var, rho, s, r, start, b, nu, S, gain, row):
    """Run the filter over series that share one model.

    Written: ``nu`` (n, n_outputs, n_series) innovations and ``S`` (n, n_outputs) their variance, both zero
    where ``b[k, o, 0]`` is NaN (``nu`` may be ``b``); ``gain`` (n, n_outputs, size) and ``row`` (n, size),
    the predicted covariance of w with the state, unless they have no samples.
    """
    n_samples, n = A.shape[0], A.shape[1]
    n_outputs, n_series = b.shape[1], b.shape[2]
    size = state_size(n, n_outputs, rho)
    x = np.zeros((size, n_series))
    moved = np.zeros((size, n_series))
    P = np.empty((size, size))
    FP = np.empty((size, size))
    F = np.empty((size, size))
    Q = np.empty(size)
    h = np.empty(size)
    Ph = np.empty(size)
    keep = row.shape[0] > 0
    _begin(P, start, w_var, s)
    for k in range(n_samples):
        if keep:
            for i in range(size):
                row[k, i] = P[n, i]
        for o in range(n_outputs):
            if np.isnan(b[k, o, 0]):
                S[k, o] = 0.0
                for c in range(n_series):
                    nu[k, o, c] = 0.0
                if keep:
                    for i in range(size):
                        gain[k, o, i] = 0.0
                continue
            _observe(h, C[k], d[k], o)
            variance = r[o]
            for i in range(size):
                total = 0.0
                for j in range(size):
                    total += P[i, j] * h[j]
                Ph[i] = total
                variance += h[i] * total
            S[k, o] = variance
            for c in range(n_series):
                error = b[k, o, c]
                for i in range(size):
                    error -= h[i] * x[i, c]
                nu[k, o, c] = error
                for i in range(size):
                    x[i, c] += Ph[i] * error / variance
            for i in range(size):
                if keep:
                    gain[k, o, i] = Ph[i] / variance
                for j in range(size):
                    P[i, j] -= Ph[i] * Ph[j] / variance
        _transition(F, A[k], g[k], phi, rho, seam[k])
        _added_variance(Q, F, start, w_var, s, seam[k])
        # only dx and w feed dx; w and v feed but themselves
        for i in range(size):
            last = n + 1 if i < n else i + 1
            begin = 0 if i < n else i
            for j in range(size):
                total = 0.0
                for m in range(begin, last):
                    total += F[i, m] * P[m, j]
                FP[i, j] = total
            for c in range(n_series):
                total = 0.0
                for m in range(begin, last):
                    total += F[i, m] * x[m, c]
                moved[i, c] = total
        for j in range(size):
            last = n + 1 if j < n else j + 1
            begin = 0 if j < n else j
            for i in range(j + 1):
                total = 0.0
                for m in range(begin, last):
                    total += FP[i, m] * F[j, m]
                P[i, j] = total
                P[j, i] = total
            P[j, j] += Q[j]
        for i in range(size):
            for c in range(n_series):
                x[i, c] = moved[i, c]


@njit(cache=True, nogil=True)
def smooth_windows(A, g, C, d, seam, phi, w_var, rho, s, start, nu, S, gain, row, w, w_variance, dx):
    """Run the smoother on what the filter kept of its first series.

    The backward pass carries the adjoint (lam, Lam) of the state in the form of Bryson and Frazier, so no
    covariance is inverted; the forward pass moves the states with the smoothed disturbances.
    Written: ``w`` (n,), ``w_variance`` (n,) in units of the filter's variance, ``dx`` (n, n_states).
    """
    n_samples, n = A.shape[0], A.shape[1]
    n_outputs = S.shape[1]
    size = state_size(n, n_outputs, rho)
    adjoint = np.empty((n_samples, size))
    lam = np.zeros(size)
    Lam = np.zeros((size, size))
    t = np.empty(size)
    T = np.empty((size, size))
    F = np.empty((size, size))
    Q = np.empty(size)
    h = np.empty(size)
    for k in range(n_samples - 1, -1, -1):
        if k + 1 < n_samples:
            _transition(F, A[k], g[k], phi, rho, seam[k])
            for i in range(size):
                total = 0.0
                for j in range(size):
                    total += F[j, i] * lam[j]
                t[i] = total
            lam[:] = t
            for i in range(size):
                for j in range(size):
                    total = 0.0
                    for m in range(size):
                        total += Lam[i, m] * F[m, j]
                    T[i, j] = total
            for i in range(size):
                for j in range(size):
                    total = 0.0
                    for m in range(size):
                        total += F[m, i] * T[m, j]
                    Lam[i, j] = total
        for o in range(n_outputs - 1, -1, -1):
            if S[k, o] == 0.0:
                continue
            _observe(h, C[k], d[k], o)
            along = 0.0
            curvature = 1.0 / S[k, o]
            for i in range(size):
                along += gain[k, o, i] * lam[i]
                total = 0.0
                for j in range(size):
                    total += Lam[i, j] * gain[k, o, j]
                t[i] = total
                curvature += gain[k, o, i] * total
            for i in range(size):
                lam[i] -= h[i] * (along + nu[k, o, 0] / S[k, o])
                for j in range(size):
                    Lam[i, j] += h[i] * h[j] * curvature - h[i] * t[j] - t[i] * h[j]
        spread = row[k, n]
        for i in range(size):
            adjoint[k, i] = lam[i]
            for j in range(size):
                spread -= row[k, i] * Lam[i, j] * row[k, j]
        w_variance[k] = max(spread, 0.0)
    x = np.zeros(size)
    P = np.empty((size, size))
    _begin(P, start, w_var, s)
    for i in range(size):
        x[i] = -P[i, i] * adjoint[0, i]
    for k in range(n_samples):
        w[k] = x[n]
        for i in range(n):
            dx[k, i] = x[i]
        if k + 1 < n_samples:
            if seam[k] < 0:
                for i in range(size):
                    x[i] = -P[i, i] * adjoint[k + 1, i]
                continue
            _transition(F, A[k], g[k], phi, rho, seam[k])
            _added_variance(Q, F, start, w_var, s, seam[k])
            for i in range(size):
                total = -Q[i] * adjoint[k + 1, i]
                for j in range(size):
                    total += F[i, j] * x[j]
                t[i] = total
            x[:] = t


@njit(cache=True, nogil=True)
def respond(A, g, C, d, seam, force, response):
    """Write the outputs' response to known forces at the port, from rest at the start of every window.

    ``force`` has shape (n, n_series), ``response`` (n, n_outputs, n_series).
    """
    n_samples, n = A.shape[0], A.shape[1]
    n_outputs, n_series = C.shape[1], force.shape[1]
    x = np.zeros((n, n_series))
    moved = np.zeros((n, n_series))
    for k in range(n_samples):
        for c in range(n_series):
            for o in range(n_outputs):
                total = d[k, o] * force[k, c]
                for i in range(n):
                    total += C[k, o, i] * x[i, c]
                response[k, o, c] = total
            for i in range(n):
                total = g[k, i] * force[k, c]
                for j in range(n):
                    total += A[k, i, j] * x[j, c]
                moved[i, c] = total if seam[k] == 0 else 0.0
        x[:] = moved


@njit(cache=True, nogil=True)
def initial_energy(A, C, seam, energy):
    """Write the energy that a unit deviation of each state at the start of the windows has in the outputs.

    ``energy`` has shape (n_states,); returned is the number of windows.
    """
    n_samples, n = A.shape[0], A.shape[1]
    travelled = np.eye(n)
    moved = np.empty((n, n))
    energy[:] = 0.0
    windows = 0
    for k in range(n_samples):
        for j in range(n):
            for o in range(C.shape[1]):
                total = 0.0
                for i in range(n):
                    total += C[k, o, i] * travelled[i, j]
                energy[j] += total * total
            for i in range(n):
                total = 0.0
                for m in range(n):
                    total += A[k, i, m] * travelled[m, j]
                moved[i, j] = total
        travelled[:] = moved
        if seam[k] != 0:
            windows += 1
            travelled[:] = 0.0
            for i in range(n):
                travelled[i, i] = 1.0
    return windows
