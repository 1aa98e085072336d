"""The HTML report: complete in itself, escaped, readable by machines and people, and quiet in a browser."""

import re
import shutil
import subprocess
from copy import copy
from dataclasses import replace
from functools import cache
from html.parser import HTMLParser
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from small_machines import held_growing, make_axis, make_growing

from narx_sklearn.discrepancy import DiscrepancyRegressor, ODESimulator
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.report_text import noise_in_words, report_text
from narx_sklearn.discrepancy.stages.refuted import LeftByForm
from narx_sklearn.discrepancy.stages.remainder import Sign
from narx_sklearn.report import render_report, write_report
from narx_sklearn.report._curves import effect_curves
from narx_sklearn.report._figures import before_and_after, thinned
from narx_sklearn.report._render import _location_tables, _residuals, _what
from narx_sklearn.report._runs import gather, whitened
from narx_sklearn.report._words import finding_table, headline, number

pytest.importorskip("jinja2")
pytest.importorskip("matplotlib")

HOSTILE = '<script>alert(\'x\')</script> & "$a_b$" --> \\$ id="b" url(#c) #012345 ]]>'
CHROMIUM = next(
    (path for name in ("chromium", "chromium-browser", "google-chrome") if (path := shutil.which(name))), None
)
CUBIC = 15.0


def stage(x, u, p):
    return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0]


def true_stage(x, u, p):
    return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0] - CUBIC * x[0] ** 3


def diagnosed(truth, names=("drive", "position"), effects=("cubic_stiffness", "quadratic_drag")):
    """Return a fitted diagnosis and its record."""
    about = {"dt": 0.05, "states": [f"{names[1]} [m]", "velocity [m/s]"], "inputs": [f"{names[0]} [V]"]}
    rng = np.random.default_rng(0)
    u = np.repeat(rng.normal(0, 3, 100), 10)
    exact = {"gain [m/s^2/V]": 1.1, "damping [1/s]": 0.7, "stiffness [1/s^2]": 11.0}
    y = ODESimulator(truth, parameters=exact, **about).simulate(u)[:, 0] + 0.005 * rng.normal(size=u.size)
    nominal = {"gain [m/s^2/V]": 1.0, "damping [1/s]": 0.8, "stiffness [1/s^2]": 12.0}
    simulator = ODESimulator(stage, parameters=nominal, **about)
    return DiscrepancyRegressor(simulator, effects=list(effects)).fit(u, y), u, y


@pytest.fixture(scope="module")
def case():
    return diagnosed(true_stage)


@pytest.fixture(scope="module")
def page(case):
    return render_report(*case, title="Bench 7", source="bench.csv", notes=["Read with commas."])


class Page(HTMLParser):
    """What a page holds: its elements with their attributes, and its text."""

    def __init__(self, text):
        super().__init__()
        self.elements, self.text = [], []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.elements.append((tag, dict(attributes)))

    def handle_data(self, data):
        self.text.append(data)

    def all(self, tag):
        return [attributes for name, attributes in self.elements if name == tag]


def test_the_verdict_stands_in_one_sentence_at_the_top(page, case):
    top = page[page.index("<h1>") : page.index("</h1>")]
    assert case[0].verdict_ in top
    assert "Cubic" in top or "cubic" in top


def test_nothing_is_loaded_from_anywhere(page):
    parsed = Page(page)
    links = [
        value
        for _, attributes in parsed.elements
        for key, value in attributes.items()
        if key in ("src", "href", "xlink:href", "action", "data")
    ]
    assert links
    assert all(link.startswith(("#", "data:")) for link in links)
    assert not parsed.all("script")
    assert "@import" not in page
    assert "default-src 'none'" in page


def test_figures_are_named_captioned_and_have_ids_of_their_own(page):
    parsed = Page(page)
    pictures = [attributes for attributes in parsed.all("svg") if "role" in attributes]
    assert len(pictures) == len(parsed.all("figure")) == len(parsed.all("figcaption"))
    assert all(picture["role"] == "img" and len(picture["aria-label"]) > 20 for picture in pictures)
    ids = [attributes["id"] for _, attributes in parsed.elements if "id" in attributes]
    assert len(ids) == len(set(ids))
    links = {a["xlink:href"][1:] for _, a in parsed.elements if a.get("xlink:href", "").startswith("#")}
    assert links <= set(ids)


def test_tables_have_captions_and_headings(page):
    parsed = Page(page)
    assert len(parsed.all("table")) >= 6
    assert all(cell["scope"] in ("row", "col") for cell in parsed.all("th"))


def test_the_numbers_of_the_diagnosis_are_in_the_page(page, case):
    dx = case[0]
    for finding in dx.findings_:
        for value in finding.parameters.values():
            assert f"<td>{number(value)}</td>" in page
    for value in dx.parameters_["augmented"]:
        assert f"<td>{number(value)}</td>" in page
    assert "Bench 7" in page
    assert "Read with commas." in page
    assert "random_state" in page


@pytest.fixture(scope="module")
def hostile_page():
    dx, u, y = diagnosed(true_stage, names=(HOSTILE, f"2{HOSTILE}"), effects=["cubic_stiffness"])
    return render_report(dx, u, y, title=HOSTILE, source=HOSTILE, notes=[HOSTILE])


def test_hostile_names_stay_text(hostile_page):
    assert "<script" not in hostile_page.lower()
    parsed = Page(hostile_page)
    assert not parsed.all("script")
    assert any("<script>alert('x')</script>" in text for text in parsed.text)
    pictures = re.findall(r"<svg.*?</svg>", hostile_page, re.DOTALL)
    assert any(HOSTILE in text for picture in pictures for text in Page(picture).text)


@cache
def of_a_single_state(driven):
    """Return the diagnosis of something that cools, with nothing missing, and its page."""

    def cooling(x, u, p):
        return (-p[0] * x[0],)

    def heated(x, u, p):
        return (u[0] - p[0] * x[0],)

    simulator = ODESimulator(
        heated if driven else cooling,
        dt=0.1,
        parameters={"rate [1/s]": 0.1},
        states=["excess [K]"],
        inputs=["heater [K/s]"] if driven else [],
        outputs=["reading [mV]"],
        output=lambda x, u, p: (2.0 * x[0],),
    )
    rng = np.random.default_rng(0)
    u = rng.normal(size=(400, int(driven)))
    y = simulator.with_parameters(np.array([0.12])).simulate(u, [20.0]) + 0.05 * rng.normal(size=(400, 1))
    dx = DiscrepancyRegressor(simulator, effects=["quadratic_drag"]).fit(u, y)
    return dx, render_report(dx, u, y)


def test_a_consistent_simulation_gets_a_report_without_findings():
    dx, page = of_a_single_state(driven=True)
    assert dx.verdict_ in ("refit", "consistent")
    assert "No effect was added." in page


def test_both_reports_tell_of_parameters_that_only_do_something_together(case):
    def heavy(x, u, p):
        return x[1], (p[1] * u[0] - p[2] * x[1] - p[3] * x[0]) / p[0]

    _, u, y = case
    about = {"dt": 0.05, "states": ["position [m]", "velocity [m/s]"], "inputs": ["drive [V]"]}
    values = {"mass [kg]": 2.0, "force [N/V]": 2.0, "damping [kg/s]": 1.6, "stiffness [N/m]": 24.0}
    simulator = ODESimulator(heavy, parameters=values, **about)
    dx = DiscrepancyRegressor(simulator, effects=["cubic_stiffness"]).fit(u, y)
    told = "Of mass, force, damping and stiffness only what they do together is told: they may all be off by"
    assert told in dx.report_
    assert told in render_report(dx, u, y)
    assert not dx.parameters_["told_alone"].any()
    assert "only what they do together" not in case[0].report_
    assert case[0].parameters_["told_alone"].all()


def test_the_page_tells_when_an_effect_acts_and_what_names_leave(case, page):
    dx, u, y = case
    told = copy(dx)
    told.findings_ = [replace(dx.findings_[0], during=(10.0, 25.5)), *dx.findings_[1:]]
    sign = Sign("bursts", "It comes in bursts.", 1e-6)
    diagnosis = replace(dx.conclusion_.diagnosis, against_noise=(sign,))
    told.conclusion_ = replace(dx.conclusion_, diagnosis=diagnosis)
    text = " ".join(Page(render_report(told, u, y)).text)
    assert f"{dx.findings_[0].place}, from 10 s to 25.5 s" in text
    assert "What these leave is no noise. It comes in bursts." in text
    assert "no noise" not in " ".join(Page(page).text)


def test_both_reports_say_how_much_a_name_that_stands_leaves(case):
    dx, u, y = case
    told = copy(dx)
    left = LeftByForm(share=0.031, deviations=1.26, doubt=0.62)
    told.conclusion_ = replace(dx.conclusion_, diagnosis=replace(dx.conclusion_.diagnosis, left=left))
    said = "These leave 3.1 % of what could be explained to a law without a name, 1.3 times the noise"
    assert said in report_text(told)
    assert said in render_report(told, u, y)
    assert "The parameters' intervals hold either way." in report_text(told)
    assert "to a law without a name" not in dx.report_


def test_both_reports_say_that_a_name_leaves_too_much(case):
    dx, u, y = case
    refuted = copy(dx)
    left = LeftByForm(share=0.31, deviations=0.068, doubt=1.0)
    refuted.verdict_ = "unknown"
    refuted.conclusion_ = replace(dx.conclusion_, diagnosis=replace(dx.conclusion_.diagnosis, left=left))
    for said in (report_text(refuted), render_report(refuted, u, y)):
        assert "0.068 times the noise (root mean square): more than a right name" in said
        assert "intervals hold either way" not in said


def test_the_curve_of_the_data_is_found_without_the_effect(case):
    dx, X, y = case
    material = gather(dx, X, y)
    curve = effect_curves(dx, material)[0]
    inner = curve.table[curve.table["argument"].abs().between(0.2, 0.8)]
    # the smoother sees only the record and the linear stage, and rounds off peaks: a tenth of them
    truth = -CUBIC * inner["argument"] ** 3
    np.testing.assert_allclose(inner["force"], truth, atol=0.1 * truth.abs().max() + 0.2)
    (k3,) = dx.findings_[0].parameters.values()
    np.testing.assert_allclose(curve.fitted, -k3 * curve.argument**3, rtol=1e-9)


def test_what_the_data_ask_of_an_output_is_what_the_sensor_took_off():
    about = {"dt": 0.05, "states": ["position [m]", "velocity [m/s]"], "inputs": ["drive [V]"]}
    rng = np.random.default_rng(1)
    u = np.repeat(rng.normal(0, 3, 100), 10)
    exact = {"gain [m/s^2/V]": 1.1, "damping [1/s]": 0.7, "stiffness [1/s^2]": 11.0}
    simulator = ODESimulator(stage, parameters=exact, **about)
    true = simulator.simulate(u)[:, 0]
    shown = np.minimum(true, 0.3) + 0.005 * rng.normal(size=u.size)
    dx = DiscrepancyRegressor(simulator, effects=["sensor_clip"]).fit(u, shown)
    assert dx.findings_[0].effect == "sensor_clip"
    curve = effect_curves(dx, gather(dx, u, shown))[0]
    _, _, at, needed, *_ = curve
    clipped = at > 0.35
    assert clipped.sum() > 20
    off = 0.05  # ten times the noise
    np.testing.assert_allclose(needed[clipped], 0.3 - at[clipped], atol=off)


def test_runs_of_an_unstable_machine_are_those_that_were_scored():
    u, y = held_growing()
    dx = DiscrepancyRegressor(make_growing(), effects=["quadratic_drag"]).fit(u, y)
    material = gather(dx, u, y)
    stretches = [(part.rows.start, part.stretch.scored.start, part.rows.stop) for part in material.held_out]
    assert stretches == list(dx.held_out_.itertuples(index=False, name=None))
    for run, rmse in dx.scores_["rmse"].items():
        errors = [(y[part.rows] - part.y[run])[part.n_init :] for part in material.held_out]
        assert np.sqrt(np.mean(np.concatenate(errors) ** 2)) == pytest.approx(rmse, rel=1e-9)
    assert f"They begin {len(stretches)} times" in render_report(dx, u, y)


@pytest.mark.parametrize("driven", [False, True])
def test_the_mismatch_of_a_single_state_is_drawn_over_the_input_or_over_time(driven):
    _, page = of_a_single_state(driven=driven)
    assert f"Where in {'heater [K/s]' if driven else 'time [s]'} and reading [mV] the mismatch is" in page


def test_headings_of_where_say_what_the_numbers_are(case):
    """A region holds a share of what an effect adds; the first of the places is as good as itself."""
    dx, _, _ = case
    event = {"start": 0, "stop": 9, "start_s": 0.0, "stop_s": 0.45, "share": 0.5, "time_share": 0.1}
    location = dx.location_._replace(
        segments=pd.DataFrame([event | {"p_value": 0.001, "event": "step of drive"}])
    )
    headings = {table.caption: table.header for table in _location_tables(location)}
    assert "share of what it adds" in headings["Regions of operation in which what was found acts most"]
    assert "p that it is as good as the first" in headings["Where in the equations it enters, best first"]
    assert "at its beginning" in headings["Stretches of time with more error than the rest"]
    unknown = location._replace(regions=location.regions.assign(effect=""))
    first = _location_tables(unknown)[0]
    assert "share of the signal" in first.header
    assert "the unknown signal at the likeliest place" in first.caption


def test_what_held_out_data_spoke_against_is_told_and_drawn_as_it_was_scored(case, page):
    """The corrected simulation then has refitted parameters alone; the scores are of what was tried."""
    dx, u, y = case
    refuted = copy(dx)
    refuted.conclusion_ = replace(dx.conclusion_, corrected=dx.refitted_simulator_)
    refuted.verdict_ = "unknown"
    (part,) = gather(refuted, u, y).held_out
    errors = y[part.rows][part.n_init :] - part.y["augmented"][part.n_init :, 0]
    assert np.sqrt(np.mean(errors**2)) == pytest.approx(dx.scores_["rmse"]["augmented"], rel=1e-9)
    told, usual = (" ".join(Page(text).text) for text in (render_report(refuted, u, y), page))
    assert "held-out error, with what was found" in told
    assert (
        "held-out data speak against it, and the corrected simulation has refitted parameters alone" in told
    )
    assert "held-out error, corrected" in usual
    assert "with what was found" not in usual


def test_another_record_is_refused(case):
    with pytest.raises(ValueError, match=r"has 1000 samples, X has 900\. Pass the X"):
        render_report(case[0], case[1][:900], case[2][:900])


def test_the_same_diagnosis_gives_the_same_page(case, page):
    again = render_report(*case, title="Bench 7", source="bench.csv", notes=["Read with commas."])
    assert again.partition("<footer>")[0] == page.partition("<footer>")[0]


def test_thinning_keeps_extremes_and_order():
    x, y = np.arange(10_000.0), np.zeros(10_000)
    y[[1234, 8765]] = 5.0, -7.0
    short_x, short_y = thinned(x, y)
    assert short_x.size <= 2 * 900
    assert (np.diff(short_x) > 0).all()
    assert {1234.0, 8765.0} <= set(short_x)
    assert short_y.max() == 5.0
    assert short_y.min() == -7.0


def test_whitening_inverts_an_autoregression_and_stops_at_sessions():
    rng = np.random.default_rng(0)
    e, r = rng.normal(size=200), np.zeros(200)
    for k in range(200):
        r[k] = e[k] + (0.7 * r[k - 1] if k % 100 else 0.0)
    noise = Noise((np.array([0.7]),), np.ones(1))
    found = whitened(r[:, None], noise, np.repeat([0, 1], 100))[:, 0]
    assert np.isnan(found[[0, 100]]).all()
    np.testing.assert_allclose(np.delete(found, [0, 100]), np.delete(e, [0, 100]), atol=1e-12)


def scores(**errors):
    """What the headline reads of a diagnosis with one finding."""
    finding = SimpleNamespace(title="a curve", place="on the output y", when="", lookalikes=(), modelled=True)
    table = pd.DataFrame({"nrmse": errors})
    apart = SimpleNamespace(steps_miss=False, record_misleads=False, unforeseen=None)
    conclusion = SimpleNamespace(diagnosis=apart, leaves_all_out=False)
    return SimpleNamespace(verdict_="unknown", findings_=[finding], scores_=table, conclusion_=conclusion)


@pytest.mark.parametrize(
    ("errors", "end"),
    [
        (
            (0.2, 0.1),
            "; on data the fit never saw the error goes from 20 % to 10 % of their spread.",
        ),
        (
            (0.1, 0.2),
            "never saw this is no better: the error goes from 10 % to 20 % of their spread.",
        ),
        ((np.inf, np.inf), "; on data the fit never saw, the free run leaves the finite range."),
        ((np.inf, 0.1), "a free run that diverged has an error of 10 % now."),
    ],
)
def test_the_headline_tells_what_became_of_the_error_whatever_it_is(errors, end):
    told = headline(scores(nominal=0.3, refitted=errors[0], augmented=errors[1]))
    assert told.endswith(end)
    assert "what comes nearest: A curve on the output y" in told


def test_a_run_that_leaves_the_recording_far_behind_does_not_squeeze_it():
    t = np.arange(100.0)
    svg = before_and_after(t, np.sin(t / 9), {"lost": np.exp(t), "good": np.sin(t / 9)}, "y [m]", "a case")
    assert not re.search(r">1e\d+<", svg)  # the scale of an axis that follows the lost run
    assert "error [m]" in svg


def test_every_number_at_the_top_and_in_the_figures_is_in_a_table_too(page):
    cells = re.findall(r"<t[hd][^>]*>([^<]*)</t[hd]>", page)
    for fact in re.findall(r"<dd>([^<]*)</dd>", page):
        assert fact in cells
    folded = re.findall(r"<summary>([^<]*)</summary>", page)
    assert folded == [
        "The difference in numbers",
        "The curve in numbers (medians in bins, 95 % intervals)",
        "The correlations in numbers (bounds in brackets)",
    ]


@pytest.mark.skipif(CHROMIUM is None, reason="needs a chromium")
@pytest.mark.parametrize("which", ["page", "hostile_page"])
def test_a_browser_shows_the_page_and_has_nothing_to_complain_of(which, request, tmp_path):
    path, shot = tmp_path / "report.html", tmp_path / "report.png"
    path.write_text(request.getfixturevalue(which), encoding="utf-8")
    quiet = ["--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking"]
    quiet += [
        "--disable-component-update",
        "--disable-sync",
        "--no-sandbox",
        f"--user-data-dir={tmp_path / 'user'}",
    ]
    done = subprocess.run(
        [CHROMIUM, "--headless", *quiet, "--enable-logging=stderr", f"--screenshot={shot}", path.as_uri()],
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    assert shot.stat().st_size > 20_000
    assert "CONSOLE" not in done.stderr


def test_a_report_is_written_to_a_file_from_a_dataframe(case, tmp_path):
    dx, u, y = case
    write_report(dx, tmp_path / "report.html", pd.DataFrame({"drive [V]": u}), pd.Series(y))
    assert (tmp_path / "report.html").read_text(encoding="utf-8").startswith("<!DOCTYPE html>")


def test_what_is_left_of_short_runs_is_tested_as_far_as_they_reach(case):
    """The scored runs of an unstable machine begin anew every few samples."""
    dx, u, y = case
    material = gather(dx, u, y)
    (told,) = _residuals(dx, material._replace(sessions=np.arange(u.size) // 4), ["position"])
    assert [row[0] for row in told["correlations"].rows] == ["0", "1", "2", "3"]
    (told,) = _residuals(dx, material._replace(sessions=np.arange(u.size)), ["position"])
    assert told == {"verdict": "Of position too few samples in a row are left for tests."}


def test_an_input_that_held_out_data_do_not_move_is_told_by_its_name(case):
    dx, u, y = case
    material = gather(dx, u, y)
    (told,) = _residuals(dx, material._replace(u=np.full_like(material.u, 2.0)), ["position"])
    assert "Input drive is constant" in told["verdict"]


def test_a_limit_that_nothing_reached_is_not_told_as_a_number():
    rng = np.random.default_rng(0)
    u = np.repeat(rng.uniform(-1.0, 3.0, 60), 20)[:, None]
    y = make_axis().simulate(np.minimum(u, 2.0)) + 0.01 * rng.normal(size=(1200, 1))
    dx = DiscrepancyRegressor(make_axis(), effects=["input_saturation"]).fit(u, y)
    assert "low" in dx.findings_[0].untold
    assert "high" not in dx.findings_[0].untold
    assert "low: these data do not tell it" in dx.report_
    assert dx.findings_[0].parameters["high"] == pytest.approx(2.0, abs=0.05)
    row = next(row for row in finding_table(dx.findings_[0], 0.9).rows if row[0] == "low")
    assert row[1] == "not told"


def test_a_finding_tells_how_much_it_adds_along_the_record(case, page):
    dx, _, y = case
    (finding,) = dx.findings_
    position = y[: int(0.8 * len(y))]
    low, high = finding.adds
    assert high == pytest.approx(-finding.parameters["k3"] * position.min() ** 3, rel=0.15)
    assert low == pytest.approx(-finding.parameters["k3"] * position.max() ** 3, rel=0.15)
    told = f"Along this record: {low:.3g} to {high:.3g} m/s^2 added to the rate of velocity."
    assert told in dx.report_
    assert told in page


def test_each_finding_has_its_own_curve_whatever_acts_first(case):
    """Findings are told by weight, effects act in another order."""
    dx, u, y = case
    model = dx.conclusion_.diagnosis.best.fit.model
    first = model.effects[0]
    second = replace(first, argument_name="another argument")
    best = replace(
        dx.conclusion_.diagnosis.best,
        fit=dx.conclusion_.diagnosis.best.fit._replace(model=model._replace(effects=(first, second))),
    )
    diagnosis = replace(dx.conclusion_.diagnosis, best=best, order=(1, 0), alternatives=((), ()))
    told = copy(dx)
    told.conclusion_ = replace(dx.conclusion_, diagnosis=diagnosis)
    told.findings_ = [replace(dx.findings_[0], title=title) for title in ("the heavier", "the lighter")]
    found = _what(told, gather(told, u, y))
    assert [one["title"] for one in found] == ["The heavier", "The lighter"]
    assert ["another argument" in one["bins"].header[0] for one in found] == [True, False]


@pytest.mark.parametrize(
    ("a", "b", "deviation", "told"),
    [
        ([], 0.0, 0.2, "0.2, white"),
        ([0.1], 0.0, 0.2001, "0.2, next to white, order 1"),
        ([0.97], 0.96, 0.20004, "0.2, next to white, with a slow part"),
        ([0.97], 0.5, 0.4, "0.4, 0.2 of it new in each sample, coloured, with a slow part"),
        ([0.995], 0.99, 0.2001, "0.2, 0.2 of it new in each sample, drifting"),
        ([1.0], 0.9, np.inf, "0.2 new in each sample, drifting"),
    ],
)
def test_noise_is_coloured_where_its_colour_adds_to_its_size(a, b, deviation, told):
    noise = {"sigma": 0.2, "deviation": deviation, "autoregression": a, "moving_average": b}
    assert noise_in_words(noise) == told
