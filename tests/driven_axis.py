"""A driven axis with damping, as several tests of the diagnosis simulate it."""

from narx_sklearn.discrepancy import ODESimulator


def axis(x, u, p):
    return x[1], p[0] * u[0] - p[1] * x[1]


def make_axis(gain=1.0, damping=0.5, equations=axis):
    return ODESimulator(
        equations,
        dt=0.02,
        parameters={"gain [m/s^2/V]": gain, "damping [1/s]": damping},
        states=["position [m]", "velocity [m/s]"],
        inputs=["drive [V]"],
    )
