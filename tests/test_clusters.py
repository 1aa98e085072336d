"""Term clusters: the thesis's Example 2.6 by hand, laws of the sums, refusals."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from narx_sklearn.analysis import term_clusters
from narx_sklearn.model import Difference, NARXModel, Polynomial, TermLibrary

THETA = (0.5, 0.2, 0.1, 0.05, -0.1, 0.02, 0.3)
MODEL_2_30 = NARXModel.from_equations(
    dict(
        zip(
            (
                "y[k-1]",
                "u[k-2]",
                "phi1[k-1]",
                "y[k-2]*u[k-4]",
                "y[k-1]*y[k-2]",
                "y[k-1]*u[k-1]",
                "u[k-1]*phi1[k-2]",
            ),
            THETA,
            strict=True,
        )
    ),
    phi=[Difference("u", name="phi1")],
)


def test_example_2_6_has_the_clusters_worked_out_there():
    clusters = term_clusters(MODEL_2_30)
    expected = {"y": 0.5, "u": 0.2, "phi1": 0.1, "y*u": 0.07, "y^2": -0.1, "u*phi1": 0.3}
    assert {c.name: pytest.approx(c.coefficient, abs=1e-15) for c in clusters.clusters} == expected
    assert [str(t) for t in clusters["y*u"].terms] == ["y[k-1]*u[k-1]", "y[k-2]*u[k-4]"]


def test_the_clustering_representation_has_each_signal_at_its_shortest_lag():
    text = term_clusters(MODEL_2_30).to_text().splitlines()[0]
    assert text == (
        "y[k] ≈ 0.5*y[k-1] + 0.2*u[k-1] + 0.1*phi1[k-1] - 0.1*y[k-1]^2 + 0.07*y[k-1]*u[k-1] "
        "+ 0.3*u[k-1]*phi1[k-1]"
    )


def test_a_cluster_that_cancels_is_listed_but_leaves_the_representation():
    clusters = term_clusters(NARXModel.from_equations("y[k-1] + 0.5*u[k-1] - 0.5*u[k-2]"))
    assert clusters["u"].coefficient == 0.0
    assert str(clusters.representation) == "y[k-1]"


@given(seed=st.integers(0, 10_000))
def test_with_all_lags_equal_the_representation_is_the_model(seed):
    rng = np.random.default_rng(seed)
    variables = ["y[k-1]", "y[k-2]", "u[k-1]", "u[k-3]"]
    library = TermLibrary.polynomial(variables, degree=3)
    chosen = library.subset(rng.choice(len(library), size=8, replace=False))
    model = NARXModel(chosen, rng.normal(size=8))
    y, u = rng.normal(size=2)
    at = {v: y if v.startswith("y") else u for v in variables}
    clusters = term_clusters(model)
    assert clusters.representation(at) == pytest.approx(model.equation()(at), rel=1e-12, abs=1e-12)
    assert sum(len(c.terms) for c in clusters.clusters) == 8


def test_each_output_has_its_own_clusters_and_a_table():
    model = NARXModel.from_equations({"y1": "0.5*y1[k-1] + 1", "y2": "0.1*y1[k-1]*y2[k-3]"})
    assert [c.name for c in term_clusters(model, output="y2").clusters] == ["y1*y2"]
    assert term_clusters(model).to_frame()["cluster"].tolist() == ["1", "y1"]
    assert isinstance(term_clusters(model).representation, Polynomial)


def test_unknown_names_are_refused_with_those_that_exist():
    with pytest.raises(ValueError, match=r"output='x' is not an output of the model; it has \['y'\]"):
        term_clusters(MODEL_2_30, output="x")
    with pytest.raises(KeyError, match=r"y has no cluster 'y\^3'"):
        term_clusters(MODEL_2_30)["y^3"]
