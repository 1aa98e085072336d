"""Models with the parameters printed in the thesis (Lacerda Junior, 2021)."""

from narx_sklearn.model import AsymmetricSign, Difference, DifferenceSign, NARXModel

PHI = (Difference("u", name="phi1"), DifferenceSign("u", name="phi2"))

EXAMPLE_2_9 = NARXModel.from_equations(
    "0.9*y[k-1] + 0.5*phi2[k-1]", phi=[DifferenceSign("u", name="phi2")]
)  # (2.59)
EXAMPLE_2_10 = NARXModel.from_equations(
    "0.9*y[k-1] + 0.5*phi2[k-1]",
    phi=[AsymmetricSign("u", rising=(0, 1), falling=(-1,), name="phi2")],
)  # (2.59) with (2.66)
THETA_4_1 = (1.0, 0.77, 1.42e-2, -9.60e-3, 3.16e-4, -2.47e-4)
EXAMPLE_4_1 = NARXModel.from_equations(
    dict(
        zip(
            (
                "y[k-1]",
                "phi1[k-1]",
                "phi2[k-1]*phi1[k-1]*u[k-1]",
                "phi2[k-1]*phi1[k-1]*y[k-1]",
                "phi1[k-1]*u[k-1]^2",
                "phi1[k-1]*u[k-1]*y[k-1]",
            ),
            THETA_4_1,
            strict=True,
        )
    ),
    phi=PHI,
    sampling_period=0.001,
    units={"u": "V", "y": "um"},
)  # (4.5)
THETA_R = (1.0, 0.7785, 0.0144, -0.0098, 3.2660e-4, -2.5767e-4, 4.9204e-5, -0.0844, -3.5147e-5)
M_R = NARXModel.from_equations(
    dict(
        zip(
            (
                "y[k-1]",
                "phi1[k-1]",
                "phi2[k-1]*phi1[k-1]*u[k-1]",
                "phi2[k-1]*phi1[k-1]*y[k-1]",
                "phi1[k-1]*u[k-1]^2",
                "phi1[k-1]*u[k-1]*y[k-1]",
                "phi2[k-1]*y[k-1]",
                "phi2[k-1]*phi1[k-1]^2",
                "phi2[k-1]*u[k-1]",
            ),
            THETA_R,
            strict=True,
        )
    ),
    phi=PHI,
)  # (5.2), Table 5.1
THETA_I = (1.0, -0.2310, 0.0146, -0.0099, 3.2333e-4, -2.5494e-4, 1.7891e-5, 1.0080, -0.0604)
M_I = NARXModel.from_equations(
    dict(
        zip(
            (
                "y[k-1]",
                "phi1[k-2]",
                "phi2[k-2]*phi1[k-2]*u[k-2]",
                "phi2[k-2]*phi1[k-2]*y[k-1]",
                "phi1[k-2]*u[k-2]^2",
                "phi1[k-2]*u[k-2]*y[k-1]",
                "phi2[k-2]*y[k-1]",
                "phi1[k-1]",
                "phi2[k-2]*phi1[k-2]^2",
            ),
            THETA_I,
            strict=True,
        )
    ),
    phi=PHI,
)  # (5.6), Table 5.1
M_INVERSE = NARXModel.from_equations(
    dict(
        zip(
            (
                "u[k-1]",
                "phi1[k-1]",
                "phi2[k-1]*phi1[k-1]*u[k-1]",
                "phi2[k-1]*phi1[k-1]*y[k-1]",
                "phi2[k-1]*y[k-1]*u[k-1]",
                "phi2[k-1]*y[k-1]^2",
                "phi1[k-1]^2*u[k-1]",
                "phi1[k-1]^2*y[k-1]",
                "phi1[k-1]^3",
            ),
            (1.0, 1.2705, -0.0160, 0.0100, -9.9216e-6, 7.3525e-6, -0.0468, 0.0344, 1.1025),
            strict=True,
        )
    ),
    outputs=("u",),
    inputs=("y",),
    phi=(Difference("y", name="phi1"), DifferenceSign("y", name="phi2")),
)  # (5.9), Table 5.1
