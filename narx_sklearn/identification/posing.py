"""What is to be identified from a record: its signals, candidate terms and constraints."""

from narx_sklearn._validation import signal_names, signal_units
from narx_sklearn.identification.one_step.procedure import Problem
from narx_sklearn.identification.records.record import Moments, Record
from narx_sklearn.identification.structure.candidates import candidate_library, named_phi, structure_filter
from narx_sklearn.identification.structure.constraints import LinearConstraints, parse_constraints
from narx_sklearn.identification.structure.hysteresis import expand_continuum


def pose(settings, record: Record) -> Problem:
    """Return the signals of a record and the candidate terms that a regressor's parameters allow."""
    labels, input_labels = record.output_labels, record.input_labels
    outputs = signal_names(labels if labels is not None else range(record.n_outputs), "y")
    inputs = signal_names(input_labels if input_labels is not None else range(record.n_inputs), "u")
    clash = set(outputs) & set(inputs)
    if clash:
        raise ValueError(f"{sorted(clash)} is the name of an input and of an output; rename a column.")
    phi = named_phi(settings.phi, outputs + inputs)
    library = candidate_library(
        outputs,
        inputs,
        phi,
        output_lags=settings.output_lags,
        input_lags=settings.input_lags,
        phi_lags=settings.phi_lags,
        delay=settings.delay,
        degree=settings.degree,
        include_constant=settings.fit_intercept,
        keep=structure_filter(settings.structure, settings.exclude, outputs, inputs, phi),
    )
    return Problem(outputs, inputs, phi, library)


def constraints_of(given, problem: Problem) -> list[LinearConstraints]:
    """Return the constraints of each output that a regressor's parameter stands for."""
    given = expand_continuum(given, problem.library, problem.outputs, problem.inputs, problem.phi)
    if isinstance(given, dict):
        unknown = set(given) - set(problem.outputs)
        if unknown:
            raise ValueError(f"constraints name {sorted(unknown)}; the outputs are {list(problem.outputs)}.")
        return [parse_constraints(given.get(output), problem.library) for output in problem.outputs]
    if given is not None and len(problem.outputs) > 1:
        raise ValueError(
            "With several outputs, constraints must be a mapping from their names: "
            f"{{{problem.outputs[0]!r}: ...}}."
        )
    return [parse_constraints(given, problem.library) for _ in problem.outputs]


def about(settings, problem: Problem, record: Record, moments: Moments) -> dict[str, object]:
    """Return what a model knows besides its equations, as `NARXModel` calls it."""
    units = signal_units(problem.outputs, record.output_labels)
    units |= signal_units(problem.inputs, record.input_labels)
    values = zip(problem.outputs + problem.inputs, *moments.range, strict=True)
    recorded = {name: (low, mean, high) for name, low, mean, high in values if low <= high}
    changes = zip(recorded, moments.change[moments.low <= moments.high].tolist(), strict=True)
    period = record.sampling_period if settings.sampling_period is None else settings.sampling_period
    return {"sampling_period": period, "units": units, "recorded": recorded, "recorded_change": dict(changes)}
