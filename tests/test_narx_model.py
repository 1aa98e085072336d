"""The NARX model as a value: equations in, text and JSON out, nothing changeable, nothing silently wrong."""

import json
import pickle
from dataclasses import FrozenInstanceError

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from narx_sklearn.exceptions import ModelFormatError
from narx_sklearn.model import (
    AsymmetricSign,
    Difference,
    DifferenceSign,
    FunctionPhi,
    HystereticOperator,
    NARXModel,
    Play,
    Polynomial,
    SmoothSign,
    TermLibrary,
)

PIEZO = {  # model (4.5) with the parameters of Example 4.1
    "y[k-1]": 1.0,
    "phi1[k-1]": 0.77,
    "phi2[k-1]*phi1[k-1]*u[k-1]": 1.42e-2,
    "phi2[k-1]*phi1[k-1]*y[k-1]": -9.60e-3,
    "phi1[k-1]*u[k-1]^2": 3.16e-4,
    "phi1[k-1]*u[k-1]*y[k-1]": -2.47e-4,
}


def piezo_model():
    return NARXModel.from_equations(PIEZO, phi=[Difference("u"), DifferenceSign("u")], sampling_period=0.001)


def full_model():
    """A model that uses every field."""
    return NARXModel.from_equations(
        {"y1": "0.5*y1[k-1] + 0.1*u2[k]*phi1[k-1]^2", "y2": "0.2*y1[k-2] - 1e-7*u1[k-3] + phi4[k-1]"},
        inputs=("u1", "u2"),
        phi=[
            SmoothSign("y1", width=0.1),
            AsymmetricSign("u1", rising=(0, 1), falling=(-1,)),
            HystereticOperator("u2"),
            Play("y2", radius=0.3),
        ],
        sampling_period=0.01,
        units={"y1": "m", "u1": "V"},
        origin={"y1": 300.0, "u2": -1.5},
        recorded={"y1": (290.0, 300.25, 310.0), "u1": (-1.0, 0.0, 1 / 3)},
    )


# --- building


def test_the_model_of_the_thesis_reads_as_printed_there():
    model = piezo_model()
    assert str(model).splitlines() == [
        "y[k] = y[k-1] + 0.77*phi1[k-1] - 0.000247*y[k-1]*u[k-1]*phi1[k-1]"
        " - 0.0096*y[k-1]*phi1[k-1]*phi2[k-1]"
        " + 0.000316*u[k-1]^2*phi1[k-1] + 0.0142*u[k-1]*phi1[k-1]*phi2[k-1]",
        "  phi1[k] = u[k] - u[k-1]",
        "  phi2[k] = sign(u[k] - u[k-1])",
    ]
    assert (model.n_terms, model.degree, model.max_lag) == (6, 3, 2)
    assert repr(model) == "<NARXModel: 6 terms, outputs ('y',), inputs ('u',)>"


def test_text_mapping_polynomial_and_library_build_the_same_model():
    expected = NARXModel(TermLibrary(["1", "y[k-1]", "u[k-1]"]), [2.0, 0.5, 1.0])
    text = "0.5*y[k-1] + u[k-1] + 2"
    assert NARXModel.from_equations(text) == expected
    assert NARXModel.from_equations({"y": text}) == expected
    assert NARXModel.from_equations(Polynomial.parse(text)) == expected
    assert NARXModel.from_equations({"u[k-1]": 1.0, "1": 2.0, "y[k-1]": 0.5}) == expected
    assert NARXModel(["1", " y[k-1]", "u[k - 1]"], [[2.0], [0.5], [1.0]]) == expected
    assert expected.equation() == Polynomial.parse(text)


def test_outputs_share_a_library_and_keep_their_own_parameters():
    model = NARXModel.from_equations({"b": "a[k-1]", "a": "0.5*b[k-1] + 2*a[k-1]"}, outputs=("a", "b"))
    assert model.library.names == ["a[k-1]", "b[k-1]"]
    np.testing.assert_array_equal(model.parameters, [[2.0, 1.0], [0.5, 0.0]])
    assert (model.n_terms, str(model.equation("b"))) == (3, "a[k-1]")


def test_other_parameters_keep_the_structure():
    model = piezo_model()
    other = model.with_parameters(2 * model.parameters)
    assert other.library == model.library
    assert other.equation() == 2 * model.equation()
    with pytest.raises(ValueError, match=r"must have shape \(6, 1\).*got shape \(5, 1\)"):
        model.with_parameters(np.ones(5))


@pytest.mark.parametrize(
    ("equation", "phi", "max_lag"),
    [
        ("2", [], 0),
        ("u[k]^2", [], 0),
        ("u[k-3] + y[k-1]", [], 3),
        ("phi1[k-2]", [Difference("u")], 3),
        ("phi1[k-2]", [Play("u", radius=1.0)], 2),
        ("phi1[k-1]", [FunctionPhi(np.abs, ["y[k-4]"])], 5),
    ],
)
def test_max_lag_counts_the_reach_of_phi_regressors(equation, phi, max_lag):
    assert NARXModel.from_equations(equation, phi=phi).max_lag == max_lag


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: NARXModel(["u[k]", "y[k-1]"], [1.0, 2.0]), "not in canonical order"),
        (lambda: NARXModel(["y[k-1]", "y[k-1]"], [1.0, 2.0]), "not in canonical order"),
        (lambda: NARXModel(["y[k-1]"], [1.0, 2.0]), r"must have shape \(1, 1\)"),
        (lambda: NARXModel(["y[k-1]"], [np.nan]), "not finite"),
        (lambda: NARXModel(["y[k]"], [1.0]), r"reads y\[k\], which is not known"),
        (lambda: NARXModel(["u[k+1]"], [1.0]), r"reads u\[k\+1\], which is not known"),
        (lambda: NARXModel(["phi1[k]"], [1.0], phi=[Play("y", radius=1.0)]), r"reads phi1\[k\]"),
        (lambda: NARXModel(["v[k]"], [1.0]), r"use \['v'\], which are neither"),
        (lambda: NARXModel(["y[k-1]"], [1.0], phi=[Difference("v")]), r"phi1 is a function of \['v'\]"),
        (lambda: NARXModel(["y[k-1]"], [1.0], inputs=("y",)), r"\['y'\] are used twice"),
        (lambda: NARXModel(["y[k-1]"], [1.0], inputs=("1u",)), "must be a letter"),
        (lambda: NARXModel(["y[k-1]"], [1.0], units={"v": "m"}), r"units names \['v'\]"),
        (lambda: NARXModel(["y[k-1]"], [1.0], origin={"v": 1.0}), r"origin names \['v'\]"),
        (
            lambda: NARXModel(["phi1[k]"], [1.0], phi=[Difference("u")], origin={"phi1": 1.0}),
            r"origin names \['phi1'\]",
        ),
        (
            lambda: NARXModel(["y[k-1]"], [1.0], origin={"y": np.inf}),
            "origin holds values that are not finite",
        ),
        (lambda: NARXModel(["y[k-1]"], [1.0], recorded={"v": (0, 0, 1)}), r"recorded names \['v'\]"),
        (
            lambda: NARXModel(["y[k-1]"], [1.0], recorded={"u": (0, 2, 1)}),
            "the least, the mean and the largest",
        ),
        (lambda: NARXModel(["y[k-1]"], [1.0], recorded={"u": (0, 1)}), r"of 'u' it holds \(0.0, 1.0\)"),
        (lambda: NARXModel(["y[k-1]"], [1.0], sampling_period=0.0), "sampling_period must be positive"),
        (lambda: NARXModel(["y[k-1]"], [1.0], sampling_period=np.inf), "sampling_period must be positive"),
        (
            lambda: NARXModel.from_equations({"a": "a[k-1]"}, outputs=("b",)),
            r"given for \['a'\], the outputs",
        ),
    ],
)
def test_inconsistent_model_is_refused(build, message):
    with pytest.raises(ValueError, match=message):
        build()


# --- a value


def test_model_cannot_be_changed():
    model = full_model()
    with pytest.raises(FrozenInstanceError):
        model.sampling_period = 1.0
    with pytest.raises(ValueError, match="read-only"):
        model.parameters[0] = 1.0
    with pytest.raises(TypeError):
        model.units["y1"] = "mm"


def test_model_keeps_no_hold_on_what_it_was_built_from():
    parameters = np.array([0.5])
    model = NARXModel(["y[k-1]"], parameters)
    parameters[0] = 9.0
    assert model.parameters[0, 0] == 0.5


@pytest.mark.parametrize("model", [piezo_model(), full_model()], ids=["piezo", "full"])
def test_model_survives_pickle_json_and_file(model, tmp_path):
    model.save(tmp_path / "model.json")
    for again in (
        pickle.loads(pickle.dumps(model)),
        NARXModel.from_dict(json.loads(json.dumps(model.to_dict()))),
        NARXModel.load(tmp_path / "model.json"),
    ):
        assert again == model
        assert hash(again) == hash(model)
        assert str(again) == str(model)
        assert again.recorded == model.recorded


def test_a_file_from_before_ranges_were_kept_still_loads():
    content = full_model().to_dict()
    del content["recorded"]
    again = NARXModel.from_dict(content)
    assert dict(again.recorded) == {}
    assert again == full_model()  # where a model comes from does not count


@given(st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=3, max_size=3))
def test_parameters_survive_json_to_the_last_bit(values):
    model = NARXModel.from_equations(dict(zip(["y[k-1]", "u[k]^2", "1"], values, strict=True)))
    assert NARXModel.from_dict(json.loads(json.dumps(model.to_dict()))) == model


def test_equality_looks_at_every_field():
    model = full_model()
    changed = [
        model.with_parameters(model.parameters * (1 + 1e-15)),
        NARXModel.from_dict(model.to_dict() | {"sampling_period": 0.02}),
        NARXModel.from_dict(model.to_dict() | {"units": {}}),
        NARXModel.from_dict(model.to_dict() | {"origin": {}}),
        NARXModel.from_dict(model.to_dict() | {"phi": [*model.to_dict()["phi"][:3], Play("y2").to_dict()]}),
    ]
    assert all(other != model for other in changed)
    assert model != "y1[k] = 0"


def test_equal_models_have_equal_hashes_also_with_signed_zeros():
    plus, minus = (NARXModel(["y[k-1]", "u[k]"], [0.5, zero]) for zero in (0.0, -0.0))
    assert plus == minus
    assert hash(plus) == hash(minus)


def test_user_function_comes_back_when_it_is_handed_over(tmp_path):
    model = NARXModel.from_equations("phi1[k-1]", phi=[FunctionPhi(np.cbrt, ["y[k]"])])
    model.save(tmp_path / "model.json")
    assert NARXModel.load(tmp_path / "model.json", functions={"cbrt": np.cbrt}) == model
    with pytest.raises(ModelFormatError, match="calls the function 'cbrt', which a file cannot hold"):
        NARXModel.load(tmp_path / "model.json")


# --- malformed files


def without(name):
    return {key: value for key, value in full_model().to_dict().items() if key != name}


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ([], "its 'format' is not"),
        (None, "its 'format' is not"),
        ({"format": "other"}, "its 'format' is not"),
        (full_model().to_dict() | {"version": 2}, "format version 2; this release reads version 1"),
        (without("version"), "format version None"),
        (without("equations"), r"lacks the entries \['equations'\]"),
        (full_model().to_dict() | {"equations": []}, "cannot be read"),
        (full_model().to_dict() | {"equations": {"y1": {"y1[k-": 1.0}, "y2": {}}}, "Cannot read 'y1"),
        (full_model().to_dict() | {"equations": {"y1": {"y1[k-1]": "x"}, "y2": {}}}, "could not convert"),
        (full_model().to_dict() | {"equations": {"y1": {"y1[k-1]": None}, "y2": {}}}, "cannot be read"),
        (full_model().to_dict() | {"equations": {"y1": {}}}, r"given for \['y1'\]"),
        (full_model().to_dict() | {"equations": {"y1": {"1": 1e999}, "y2": {}}}, "not finite"),
        (full_model().to_dict() | {"sampling_period": "fast"}, "cannot be read"),
        (full_model().to_dict() | {"inputs": 5}, "cannot be read"),
        (full_model().to_dict() | {"units": 5}, "cannot be read"),
        (full_model().to_dict() | {"origin": {"y1": "x"}}, "could not convert"),
        (full_model().to_dict() | {"recorded": {"y1": 5}}, "cannot be read"),
        (full_model().to_dict() | {"phi": [5]}, "cannot be read"),
        (full_model().to_dict() | {"phi": [{"type": []}]}, "cannot be read"),
        (
            full_model().to_dict() | {"phi": [{"type": "Play", "signal": "y2", "radius": "x"}]},
            "radius of Play",
        ),
        (
            full_model().to_dict() | {"phi": [{"type": "FunctionPhi", "function": "abs"}]},
            "at least one variable",
        ),
    ],
)
def test_malformed_content_is_refused_with_the_reason(content, message):
    with pytest.raises(ModelFormatError, match=message):
        NARXModel.from_dict(content, {"abs": abs})


@pytest.mark.parametrize("content", [b"{", b"\xff\xfe", b""], ids=["cut off", "not text", "empty"])
def test_file_that_is_not_json_is_refused_by_name(tmp_path, content):
    path = tmp_path / "model.json"
    path.write_bytes(content)
    with pytest.raises(ModelFormatError, match=r"model\.json is not JSON"):
        NARXModel.load(path)


# --- operating point and text


def test_expanded_model_has_no_origin_and_the_binomial_coefficients():
    # y - 2 = 0.5 (y[k-1] - 2) + 3 (u[k] - 1)^2
    model = NARXModel.from_equations("0.5*y[k-1] + 3*u[k]^2", origin={"y": 2.0, "u": 1.0})
    expanded = model.expanded()
    assert not expanded.origin
    assert expanded.equation() == Polynomial.parse("4 + 0.5*y[k-1] - 6*u[k] + 3*u[k]^2")
    assert expanded.expanded() is expanded


def test_text_names_the_operating_point_with_units():
    assert str(full_model()).splitlines()[-1] == (
        "  in deviations from the operating point: y1 - 300 m, u2 + 1.5"
    )
    assert "phi2" not in str(full_model())  # defined but in no equation


def test_latex_has_one_line_for_each_output():
    lines = full_model().latex().splitlines()
    assert len(lines) == 2
    assert lines[0] == r"y_{1,k} = 0.5\, y_{1,k-1} + 0.1\, u_{2,k} \phi_{1,k-1}^{2} \\"


def test_what_is_printed_is_read():
    text = "speed[k] = 0.5*speed[k-1] - 2*drive[k-1]^2"
    model = NARXModel.from_equations(text, inputs=["drive"])
    assert str(model) == text
    two = NARXModel.from_equations("y1[k] = 0.5*y2[k-1]\ny2[k] = u[k-1] + 1")
    assert NARXModel.from_equations(str(two)) == two
    assert NARXModel.from_equations({"y": "y[k] = 0.5*y[k-1]"}) == NARXModel.from_equations("0.5*y[k-1]")


@pytest.mark.parametrize(
    ("equations", "message"),
    [
        ("y[k] = 0.5*y[k-1]\n  phi1[k] = u[k] - u[k-1]", "is passed as phi and origin"),
        ("y[k-1] = 0.5*y[k-2]", "write it like 'y"),
        ("y[k] = y[k-1]\ny[k] = u[k-1]", "two equations of 'y'"),
        ({"z": "y[k] = 0.5*y[k-1]"}, "given for 'z' is that of 'y'"),
        ("y[k] = 0.5*y[k-1] + drive[k-1]", r"Say what they are, as with inputs=\['drive'\] or outputs"),
    ],
)
def test_equations_that_cannot_be_read_say_how_they_are_written(equations, message):
    with pytest.raises(ValueError, match=message):
        NARXModel.from_equations(equations)


def test_an_operating_point_below_zero_has_one_sign():
    model = NARXModel.from_equations("0.5*y[k-1]", origin={"y": 3, "u": -0.013624}, units={"u": "V"})
    assert str(model).endswith("operating point: y - 3, u + 0.013624 V")
