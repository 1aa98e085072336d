"""A model as C: what it computes is the free run, whatever its lags, inputs and phi regressors."""

import shutil
import subprocess

import numpy as np
import pytest

from narx_sklearn.compensation import model_c_source
from narx_sklearn.compensation.model_code import simulation_law
from narx_sklearn.model import (
    AbsoluteDifference,
    Difference,
    DifferenceSign,
    FunctionPhi,
    HystereticOperator,
    NARXModel,
    Play,
    SmoothSign,
    free_run,
)

LOOP = {"y[k-1]": 0.6, "phi1[k-1]": 0.3, "phi2[k-2]*u[k-1]": 0.02, "phi3[k-1]": 0.1, "u[k-1]": 0.4}
MODELS = {
    "linear": NARXModel.from_equations("0.5*y[k-1] - 0.1*y[k-3] + 0.3*u[k-2]"),
    "at once": NARXModel.from_equations("0.7*y[k-1] + 0.2*u[k] + 0.1*u[k-1]^2*y[k-2]"),
    "named, from an operating point": NARXModel.from_equations(
        "heat[k] = 0.9*heat[k-1] + 0.05*m[k-1] - 0.01*heat[k-1]*m[k-2]", inputs=["m"],
        origin={"heat": 20.0, "m": 3.0},
    ),
    "two inputs of other delays": NARXModel.from_equations(
        "0.8*y[k-1] + 0.1*u[k-3] + 0.05*v[k-1]*y[k-1] + 0.02*dv[k-1]", inputs=["u", "v"],
        phi=[Difference("v", name="dv")],
    ),
    "loop": NARXModel.from_equations(
        LOOP, phi=[Difference("u"), DifferenceSign("u"), AbsoluteDifference("y")]
    ),
    "memory": NARXModel.from_equations(
        {"y[k-1]": 0.5, "play[k-1]": 0.3, "loop[k-1]": 0.1, "soft[k-1]": 0.05},
        phi=[Play("u", radius=0.2, name="play"), HystereticOperator("u", name="loop"),
             SmoothSign("y", 0.1, name="soft")],
    ),
}  # fmt: skip


def inputs_of(model, n_samples=120):
    rng = np.random.default_rng(3)
    steps = np.cumsum(0.2 * rng.normal(size=(n_samples, len(model.inputs))), axis=0)
    steps[: model.max_lag + 2] = steps[0]  # held, as a reset says
    return np.round(steps, 3)


def rest_of(model, X):
    return free_run(model, np.repeat(X[:1], 400, axis=0), np.zeros(model.max_lag)).y[-1, 0]


def program_of(model, folder):
    n = len(model.inputs)
    read = "".join(f'if (scanf("%lf", u + {i}) != 1) return 0;\n    ' for i in range(n))
    values = ", ".join(f"u[{i}]" for i in range(n))
    driver = (
        "#include <stdio.h>\nint main(void)\n{\n    model_state s;\n    double y, u[8];\n"
        f'    if (scanf("%lf", &y) != 1) return 1;\n    {read}\n    model_reset(&s, y, {values});\n'
        f'    for (;;) {{ {read} printf("%.17g\\n", model_step(&s, {values})); }}\n}}\n'
    )
    source, program = folder / "model.c", folder / "model"
    source.write_text(model_c_source(model) + driver)
    flags = ["-std=c99", "-O0", "-ffp-contract=off", "-Wall", "-Wextra", "-Werror", "-Wno-unused-function"]
    subprocess.run(["gcc", *flags, str(source), "-o", str(program), "-lm"], check=True)
    return program


@pytest.mark.skipif(shutil.which("gcc") is None, reason="no C compiler")
@pytest.mark.parametrize("name", MODELS)
def test_the_c_code_computes_the_free_run(name, tmp_path):
    model = MODELS[name]
    X, (_, delay) = inputs_of(model), simulation_law(model)
    rest = rest_of(model, X)
    run = free_run(model, X, np.full(model.max_lag, rest)).y[:, 0]
    text = "\n".join(map(repr, [float(rest), *X[0].tolist(), *X.ravel().tolist()]))
    done = subprocess.run(
        [str(program_of(model, tmp_path))], input=text, capture_output=True, text=True, check=True
    )
    computed = np.array(done.stdout.split(), dtype=float)
    np.testing.assert_allclose(computed[: run.size - delay], run[delay:], rtol=1e-9, atol=1e-11)
    assert np.ptp(run) > 0.05


def test_what_a_step_returns_is_told():
    assert "The newest u; return y 2 samples later." in model_c_source(MODELS["linear"])
    assert "The newest u; return y at the same sample." in model_c_source(MODELS["at once"])
    assert "heat (m) and m have been held" in model_c_source(MODELS["named, from an operating point"])


def test_functions_of_the_users_are_refused():
    model = NARXModel.from_equations("0.5*y[k-1] + f[k-1]", phi=[FunctionPhi(np.tanh, ["u[k]"], name="f")])
    with pytest.raises(ValueError, match=r"\['f'\] are functions of yours, of which there is no C"):
        model_c_source(model)


def test_several_outputs_are_refused():
    model = NARXModel.from_equations({"a": "0.5*a[k-1] + u[k-1]", "b": "a[k-1]"}, outputs=["a", "b"])
    with pytest.raises(ValueError, match=r"the model has \['a', 'b'\]"):
        model_c_source(model)
