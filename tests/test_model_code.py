"""A model as C: what it computes is the free run, whatever its lags, inputs and phi regressors."""

import shutil
import subprocess

import numpy as np
import pytest

from narx_sklearn.compensation import model_c_source
from narx_sklearn.compensation.model_code import least_delay
from narx_sklearn.model import (
    AbsoluteDifference,
    AsymmetricSign,
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
    "memory, from an operating point": NARXModel.from_equations(
        {"y[k-1]": 0.5, "play[k-1]": 0.3, "loop[k-1]": 0.1, "bend[k-1]*u[k-2]": 0.05},
        phi=[Play("u", radius=0.2, name="play"), HystereticOperator("u", name="loop"),
             AsymmetricSign("u", [0.2, 1.0], [0.1, -0.5], name="bend")],
        origin={"u": 0.7, "y": -0.4},
    ),
    "coupled outputs": NARXModel.from_equations(
        {"a": "0.6*a[k-1] - 0.2*b[k-2] + 0.3*u[k-1]", "b": "0.7*b[k-1] + 0.1*a[k-1]*u[k-1] + 0.2*u[k-3]"},
        outputs=["a", "b"],
    ),
    "outputs with other delays, phi of inputs and outputs": NARXModel.from_equations(
        {
            "hoehe": "0.9*hoehe[k-1] + 0.1*u[k-4] + 0.02*turns[k-1]",
            "höhe": "0.5*höhe[k-1] + 0.3*v[k-2]*hoehe[k-1] + 0.2*play[k-2] + 0.1*move[k-2]",
            "m": "0.4*m[k-2] + 0.3*höhe[k-1]",
        },
        outputs=["hoehe", "höhe", "m"], inputs=["u", "v"], origin={"v": 2.0, "m": 1.0},
        phi=[SmoothSign("höhe", 0.1, name="turns"), Play("u", radius=0.3, name="play"),
             Difference("v", name="move")],
    ),
}  # fmt: skip


def inputs_of(model, n_samples=120):
    rng = np.random.default_rng(3)
    steps = np.cumsum(0.2 * rng.normal(size=(n_samples, len(model.inputs))), axis=0)
    steps[: model.max_lag + 2] = steps[0]  # held, as a reset says
    return np.round(steps, 3)


def rest_of(model, X):
    n = len(model.outputs)
    return free_run(model, np.repeat(X[:1], 400, axis=0), np.zeros((model.max_lag, n))).y[-1]


def program_of(model, folder):
    n, n_outputs = len(model.inputs), len(model.outputs)

    def read(array, count):
        return "".join(f'if (scanf("%lf", {array} + {i}) != 1) return 0;\n    ' for i in range(count))

    values = ", ".join(f"u[{i}]" for i in range(n))
    step = f"y[0] = model_step(&s, {values});" if n_outputs == 1 else f"model_step(&s, {values}, y);"
    driver = (
        "#include <stdio.h>\nint main(void)\n{\n    model_state s;\n    double y[8], u[8];\n    int i;\n"
        f"    {read('y', n_outputs)} {read('u', n)}\n"
        f"    model_reset(&s, {'y[0]' if n_outputs == 1 else 'y'}, {values});\n"
        f"    for (;;) {{ {read('u', n)} {step}\n"
        f'        for (i = 0; i < {n_outputs}; i++) printf("%.17g\\n", y[i]); }}\n}}\n'
    )
    source, program = folder / "model.c", folder / "model"
    source.write_text(model_c_source(model) + driver, encoding="utf-8")
    flags = ["-std=c99", "-O0", "-ffp-contract=off", "-Wall", "-Wextra", "-Werror", "-Wno-unused-function"]
    subprocess.run(["gcc", *flags, str(source), "-o", str(program), "-lm"], check=True)
    return program


def computed_by(program, rest, X, n_outputs):
    text = "\n".join(map(repr, [*rest.tolist(), *X[0].tolist(), *X.ravel().tolist()]))
    done = subprocess.run([str(program)], input=text, capture_output=True, text=True, check=True)
    return np.array(done.stdout.split(), dtype=float).reshape(-1, n_outputs)


@pytest.mark.skipif(shutil.which("gcc") is None, reason="no C compiler")
@pytest.mark.parametrize("name", MODELS)
def test_the_c_code_computes_the_free_run(name, tmp_path):
    model = MODELS[name]
    X, delay = inputs_of(model), least_delay(model)
    rest = rest_of(model, X)
    run = free_run(model, X, np.tile(rest, (model.max_lag, 1))).y
    computed = computed_by(program_of(model, tmp_path), rest, X, len(model.outputs))
    np.testing.assert_allclose(computed[: len(run) - delay], run[delay:], rtol=1e-9, atol=1e-11)
    assert np.ptp(run, axis=0).min() > 0.05


@pytest.mark.skipif(shutil.which("gcc") is None, reason="no C compiler")
def test_an_input_that_is_not_finite_is_taken_as_it_was_last(tmp_path):
    model = MODELS["coupled outputs"]
    program = program_of(model, tmp_path)
    held, lost = np.full((6, 1), 2.0), np.full((6, 1), 2.0)
    lost[2:4] = np.nan
    computed = computed_by(program, np.zeros(2), lost, 2)
    np.testing.assert_array_equal(computed, computed_by(program, np.zeros(2), held, 2))
    # worked by hand: the reset held u = 2 and zero outputs, b has 0.2*u[k-3] from the first step on
    np.testing.assert_allclose(computed[:2], [[0.6, 0.4], [0.96, 0.8]], rtol=1e-12)


def test_what_a_step_returns_is_told():
    assert "The newest u; return y 2 samples later." in model_c_source(MODELS["linear"])
    assert "The newest u; return y at the same sample." in model_c_source(MODELS["at once"])
    assert "Rest: heat and m have been held" in model_c_source(MODELS["named, from an operating point"])
    assert "The newest u; write a, b 1 sample later." in model_c_source(MODELS["coupled outputs"])


def test_functions_of_the_users_are_refused():
    model = NARXModel.from_equations("0.5*y[k-1] + f[k-1]", phi=[FunctionPhi(np.tanh, ["u[k]"], name="f")])
    with pytest.raises(ValueError, match=r"\['f'\] are functions of yours, of which there is no C"):
        model_c_source(model)


def test_a_model_without_input_is_refused():
    with pytest.raises(ValueError, match=r"The model has no input, .* Simulate it with free_run"):
        model_c_source(NARXModel.from_equations("0.5*y[k-1]", inputs=[]))


@pytest.mark.parametrize("name", ["2nd", "a b", "größe", ""])
def test_a_name_that_c_does_not_know_is_refused(name):
    with pytest.raises(ValueError, match="is no C identifier; use letters"):
        model_c_source(MODELS["linear"], name)
