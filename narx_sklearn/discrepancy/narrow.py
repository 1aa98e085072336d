"""What is said of parameters of the simulation that lie at their bounds."""

from collections.abc import Collection

from narx_sklearn.discrepancy.records.finding import DataFinding
from narx_sklearn.discrepancy.search.inference import intervals
from narx_sklearn.discrepancy.settings import Settings
from narx_sklearn.discrepancy.stages.bounded import AtBound, at_bounds, fit_beyond
from narx_sklearn.discrepancy.stages.diagnosis import Diagnosis


def bounds_as_findings(diagnosis: Diagnosis, settings: Settings) -> list[DataFinding]:
    """Return a finding for each bound that was given and that the record would have a parameter pass.

    Beside what was found a bound may still stand in the way, and what was found stand in for what it forbids.
    """
    if diagnosis.narrow:
        sure = intervals(diagnosis.problem, diagnosis.refitted, settings.level)
        return [
            _finding(
                at,
                (value := float(diagnosis.refitted.model.p[at.number])),
                f"Without that bound it is {_with_unit(at, value)} "
                f"({sure[at.number, 0]:.4g} to {sure[at.number, 1]:.4g}), and nothing is missing: the bound "
                "is too narrow. All else is told without it.",
            )
            for at in diagnosis.narrow
        ]
    beyond = fit_beyond(diagnosis.problem, diagnosis.best.fit, settings.alpha, settings.n_jobs)
    if beyond is None:
        return []
    beside = "Beside what was found it" if diagnosis.best.effects or diagnosis.unforeseen else "It"
    return [
        _finding(
            at,
            (value := float(beyond.fit.model.p[at.number])),
            f"{beside} would be {_with_unit(at, value)} without that bound, and {100 * beyond.less:.2g} % "
            "less be left (mean square). What a bound forbids may be taken for physics: widen it and "
            "diagnose again, unless it is certain.",
        )
        for at in beyond.passed
    ]


def what_lies_at_bounds(diagnosis: Diagnosis, told: Collection[str] = ()) -> list[str]:
    """Return a sentence for each parameter that lies at its bound beside what was found, but those told."""
    lying = at_bounds(diagnosis.problem, diagnosis.best.fit)
    return [f"{_lies(at)}." for at in lying if at.parameter.name not in told]


def _lies(at: AtBound) -> str:
    if not at.is_given:
        return f"{at.parameter.name} lies at {at.bound:.4g}, as far as its sign lets it go"
    return f"{at.parameter.name} lies at its {_side(at)} bound, {_with_unit(at, at.bound)}"


def _side(at: AtBound) -> str:
    return "upper" if at.is_upper else "lower"


def _with_unit(at: AtBound, value: float) -> str:
    return f"{value:.4g} {at.parameter.unit}".rstrip()


def _finding(at: AtBound, freed: float, words: str) -> DataFinding:
    return DataFinding(
        "bounds",
        f"{_lies(at)}. {words}",
        {"parameter": at.parameter.name, "bound": at.bound, "side": _side(at), "freed": freed},
    )
