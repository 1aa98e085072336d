"""What is said of parameters of the simulation that are not the same in all sessions."""

from collections.abc import Sequence

import numpy as np

from narx_sklearn.discrepancy.fitting.acting import port_in_words
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.records.finding import DataFinding
from narx_sklearn.discrepancy.stages.apart import Part, differing, own_parameters
from narx_sklearn.discrepancy.stages.diagnosis import Diagnosis


def sessions_as_findings(diagnosis: Diagnosis) -> list[DataFinding]:
    """Return a finding if sessions with parameters of their own leave less than one set for all."""
    if not diagnosis.apart:
        return []
    parameters = diagnosis.problem.simulator.parameters
    values, sure = own_parameters(diagnosis.apart)
    told = np.flatnonzero(differing(values, sure)).tolist()
    together = diagnosis.together or Part(diagnosis.problem, diagnosis.refitted)
    before, after = (float(np.sqrt(_left(parts))) for parts in ([together], diagnosis.apart))
    listed = "; ".join(
        f"{parameters[i].name} = "
        + ", ".join(
            f"{v:.4g} ({a:.4g} to {b:.4g})" for v, (a, b) in zip(values[:, i], sure[:, i], strict=True)
        )
        + f" {parameters[i].unit}".rstrip()
        for i in told
    )
    return [
        DataFinding(
            "sessions",
            "The simulation's parameters are not the same in all sessions. In one after the other: "
            f"{listed}. One set for all leaves {100 * before:.3g} % of the outputs' spread, own ones leave "
            f"{100 * after:.3g} %; {_outcome(diagnosis)}",
            {
                "parameters": {parameters[i].name: values[:, i].tolist() for i in told},
                "intervals": {parameters[i].name: sure[:, i].tolist() for i in told},
                "missed": [effect.name.code for effect in diagnosis.missed_in_each],
                "before": before,
                "after": after,
            },
        )
    ]


def _outcome(diagnosis: Diagnosis) -> str:
    """Return what is missing besides, and what can be done."""
    if diagnosis.is_apart:
        return (
            "no session by itself misses anything. Something was changed in between (a payload, a medium, a "
            "supply): simulate each with its own parameters (with_parameters), or give what was changed as a "
            "measured input. The corrected simulation has one set for all: what all of them say of the rest, "
            "and between what they say of what differs."
        )
    if diagnosis.of_session is not None:
        began = [int(part.problem.windows.began[0]) for part in diagnosis.apart]
        return (
            f"{_missed(diagnosis)} is missing in each. Something was changed in between (a payload, a "
            "medium, a supply): give it as a measured input. All that follows is of session "
            f"{began.index(diagnosis.of_session) + 1} by itself, and so is the corrected simulation; "
            "simulate the others with their own parameters."
        )
    if diagnosis.is_named:
        return (
            "what is named acts besides. Something was changed in between (a payload, a medium, a supply): "
            "give it as a measured input, or simulate each with its own parameters (with_parameters); the "
            "corrected simulation has one set for all."
        )
    return (
        "that is less than with all that was found. Something was changed in between (a payload, a medium, a "
        "supply), or a law without a name looks like other parameters where the machine is moved farther: "
        "diagnose the sessions one by one."
    )


def _missed(diagnosis: Diagnosis) -> str:
    """Return what each session misses, and where, in words."""
    simulator = diagnosis.problem.simulator
    effects = diagnosis.missed_in_each
    return " and ".join(f"{e.name.title} {port_in_words(e.port, simulator)}" for e in effects)


def _left(parts: Sequence[Part]) -> float:
    """Return the share of the outputs' variance that is left."""
    spread = Noise.as_large_as(parts[0].problem.y).sigma  # of the whole record, whichever windows a part has
    left = sum(float(np.sum((part.problem.left_over(part.fit.model) / spread) ** 2)) for part in parts)
    return left / max(sum(int(part.problem.seen.sum()) for part in parts), 1)
