"""Spurious term clusters of an overparametrised model."""

import numpy as np
import pandas as pd
import pytest

from narx_sklearn import NARXRegressor
from narx_sklearn.identification import Factor, SelectionPath, least_squares, search_terms
from narx_sklearn.identification.transformers import TermTransformer
from narx_sklearn.identification.validation.spurious import detect_spurious_clusters
from narx_sklearn.model import TermLibrary

TRUE_CLUSTERS = {"y", "u", "u^2", "y*u^2"}


def record(seed, n_samples=800, equation=0.1, output=0.0):
    """Return signals of a system with the four true clusters, under a smooth input."""
    rng = np.random.default_rng(seed)
    u = np.convolve(rng.normal(size=n_samples + 5), np.ones(6) / 2, "valid")
    e, y = equation * rng.normal(size=n_samples), np.zeros(n_samples)
    for k in range(2, n_samples):
        y[k] = 0.6 * y[k - 1] + 0.2 * y[k - 2] + u[k - 1] - 0.3 * u[k - 2] + e[k]
        y[k] += 0.1 * u[k - 1] * u[k - 2] - 0.05 * y[k - 1] * u[k - 1] ** 2
    return pd.DataFrame({"y": y + output * rng.normal(size=n_samples), "u": u})


def candidates(signals, degree=3):
    """Return the factor and library of every term of three lags: 84 for a system of six."""
    terms = TermTransformer(lags=3, degree=degree, include_constant=True)
    Psi = terms.fit_transform(signals)[3:]
    return Factor.of(Psi, signals["y"].to_numpy()[3:]), terms.library_


@pytest.mark.parametrize(("equation", "output"), [(0.1, 0.0), (0.1, 0.2)])
def test_clusters_of_the_system_are_effective_and_others_are_not(equation, output):
    """Ten records: no true cluster is doubted, one false one at most passes, most are called spurious."""
    verdicts = []
    for seed in range(10):
        report = detect_spurious_clusters(*candidates(record(seed, equation=equation, output=output)))
        verdicts += [(one.cluster in TRUE_CLUSTERS, one.verdict) for one in report.clusters]
    assert verdicts.count((True, "effective")) == 40
    assert verdicts.count((False, "effective")) <= 1
    assert verdicts.count((False, "spurious")) > verdicts.count((False, "doubtful"))


def test_evidence_is_that_of_the_growing_model():
    """Coefficients, entry, ratio and growth against least squares done anew for every size."""
    factor, library = candidates(record(4))
    path = search_terms(factor, 12, search="forward")
    report = detect_spurious_clusters(factor, library, path)
    one = next(one for one in report.clusters if one.cluster == "u^3")
    own = [i for i, term in enumerate(library) if term.cluster == (("u", 3),)]
    ratios = []
    for size, support in enumerate(path.supports):
        inside = sorted(set(support) & set(own))
        if not inside:
            assert np.isnan(one.coefficients[size])
            assert size < one.first_size
            continue
        columns = sorted(support)
        theta = least_squares(factor.subset(columns))[0][[columns.index(i) for i in inside]]
        assert one.coefficients[size] == pytest.approx(theta.sum(), abs=1e-12)
        if len(inside) > 1 and size >= report.chosen_size:
            ratios.append(abs(theta.sum()) / np.abs(theta).max())
    assert one.ratio == pytest.approx(np.median(ratios))
    without = factor.subset([i for i in range(len(library)) if i not in own])
    shorter = search_terms(without, report.chosen_size, search="floating")
    assert one.growth == pytest.approx(shorter.rss[report.chosen_size] / path.rss[report.chosen_size])


def test_standard_error_is_that_of_the_sum_of_parameters():
    signals = record(0)
    factor, library = candidates(signals)
    report = detect_spurious_clusters(factor, library)
    path = search_terms(factor, 20, search="forward")
    columns = sorted(path.supports[-1])
    Psi = TermTransformer(lags=3, degree=3, include_constant=True).fit_transform(signals)[3:, columns]
    covariance = path.rss[-1] / (len(Psi) - 20) * np.linalg.inv(Psi.T @ Psi)
    for one in report.clusters:
        own = np.array([report_cluster(library[i]) == one.cluster for i in columns], dtype=float)
        assert one.standard_error == pytest.approx(np.sqrt(own @ covariance @ own), rel=1e-6)


def report_cluster(term):
    return "*".join(f"{s}^{e}" if e > 1 else s for s, e in term.cluster) or "1"


def test_a_derivative_is_not_called_spurious_though_its_coefficient_vanishes():
    """2 (u[k-1] - u[k-2]) has a cluster coefficient of zero, and is the physics."""
    rng = np.random.default_rng(0)
    u = rng.normal(size=500)
    y = np.zeros(500)
    for k in range(2, 500):
        y[k] = 0.8 * y[k - 1] + 2.0 * (u[k - 1] - u[k - 2]) + 0.05 * rng.normal()
    report = detect_spurious_clusters(*candidates(pd.DataFrame({"y": y, "u": u}), degree=2))
    one = report.clusters[0]
    assert (one.cluster, one.verdict) == ("u", "doubtful")
    assert one.ratio < 0.01
    assert one.growth > 10
    assert "but without it the residual variance is" in one.reason


def test_excluded_clusters_leave_the_candidates_of_a_regressor():
    signals = record(3)
    report = detect_spurious_clusters(*candidates(signals))
    assert report.spurious
    narx = NARXRegressor(output_lags=3, input_lags=3, degree=3, exclude=report.spurious, refine=False).fit(
        signals[["u"]], signals["y"]
    )
    clusters = {report_cluster(term) for term in narx.candidates_}
    assert not clusters & set(report.spurious)
    assert {report_cluster(t) for t in narx.model_.library} == TRUE_CLUSTERS


def test_units_change_the_coefficients_and_no_verdict():
    signals = record(5)
    factor, library = candidates(signals)
    scaled, _ = candidates(signals * [1e-3, 1e2])
    scales = np.array(
        [1e-3 / np.prod([{"y": 1e-3, "u": 1e2}[v.signal] for v in t.expanded]) for t in library]
    )
    plain = detect_spurious_clusters(factor, library, scales=scales)
    report = detect_spurious_clusters(scaled, library)
    assert plain.to_frame()["verdict"].to_dict() == report.to_frame()["verdict"].to_dict()
    pd.testing.assert_frame_equal(plain.coefficients(), report.coefficients(), rtol=1e-5)


def test_without_noise_the_effective_clusters_are_those_of_the_system():
    """Forward selection takes u^3 before it has u^2 and y*u^2; other terms then do as well without it."""
    report = detect_spurious_clusters(*candidates(record(0, equation=0.0)))
    assert {one.cluster for one in report.clusters if one.verdict == "effective"} == TRUE_CLUSTERS
    assert report.spurious == ["u^3"]


def test_the_only_cluster_is_effective():
    rng = np.random.default_rng(0)
    Psi = rng.normal(size=(50, 2))
    factor = Factor.of(Psi, Psi @ [1.0, 0.5] + 0.1 * rng.normal(size=50))
    report = detect_spurious_clusters(factor, TermLibrary(["u[k-1]", "u[k-2]"]))
    assert [one.verdict for one in report.clusters] == ["effective"]
    assert report.clusters[0].growth > 10


def test_the_report_prints_as_a_table():
    report = detect_spurious_clusters(*candidates(record(0)))
    frame = report.to_frame()
    assert frame.index.tolist() == [one.cluster for one in report.clusters]
    assert frame["first_size"].is_monotonic_increasing
    assert all(cluster in str(report) for cluster in frame.index)
    assert set(report.spurious) | set(report.doubtful) == set(frame.index[frame["verdict"] != "effective"])
    assert report.coefficients().shape == (21, len(frame))


def test_what_does_not_belong_together_is_refused():
    factor, library = candidates(record(0, 60))
    with pytest.raises(ValueError, match="The factor has 84 terms and the library 2; they must agree"):
        detect_spurious_clusters(factor, TermLibrary(["y[k-1]", "u[k-1]"]))
    path = SelectionPath(((),), np.ones(1), total=1.0, n_samples=57, n_candidates=5)
    with pytest.raises(ValueError, match="The path chose from 5 terms and the library has 84"):
        detect_spurious_clusters(factor, library, path)
