"""A model as C, to simulate it in a controller or another program: an observer, a virtual sensor.

A model that is simulated is a law without anything to solve: what `CompensationLaw` calls the input wanted is
the model's output, and what it calls the reference is the model's input.
"""

from narx_sklearn.compensation.c_code import Words, written
from narx_sklearn.compensation.law import INPUT, REFERENCE, CompensationLaw
from narx_sklearn.compensation.letters import element_of, least_lag, letters_of, signals_of, with_letters
from narx_sklearn.model.narx import NARXModel
from narx_sklearn.model.phi import FunctionPhi
from narx_sklearn.model.polynomials import Polynomial

__all__ = ["model_c_source", "simulation_law"]


def model_c_source(model: NARXModel, name: str = "model") -> str:
    """Return C99 source that simulates a model: ``<name>_state``, ``<name>_reset`` and ``<name>_step``.

    ``<name>_step`` takes the newest inputs and returns the output that follows from them: at the same sample
    where an input acts at once, else as many samples later as the least lag of the inputs says.
    ``<name>_reset`` holds output and inputs at values of yours, the model's steady state as a rule. What it
    computes are the numbers of `free_run`, with all digits of the parameters; it allocates nothing and needs
    ``math.h`` only.

    Parameters
    ----------
    model : NARXModel
        The model, of one output.
    name : str, default="model"
        Prefix of all names; a C identifier.

    Returns
    -------
    str

    Raises
    ------
    ValueError
        If the model has several outputs, no input or functions of the user's, or ``name`` is no identifier.

    See Also
    --------
    c_source : A compensation law as C.

    Examples
    --------
    >>> from narx_sklearn.compensation import model_c_source
    >>> from narx_sklearn.model import NARXModel
    >>> model = NARXModel.from_equations("heat[k] = 0.1*drive[k-2] + 0.9*heat[k-1]", inputs=["drive"])
    >>> for line in model_c_source(model, "oven").splitlines()[:4]:
    ...     print(line)
    /* Simulation of
     * heat[k] = 0.1*drive[k-2] + 0.9*heat[k-1]
     * m stands for heat, r for drive.
     */
    """
    law, delay = simulation_law(model)
    letters = zip((INPUT, *law.known), (model.outputs[0], *model.inputs), strict=True)
    named = ", ".join(f"{letter} for {signal}" for letter, signal in letters if letter != signal)
    when = f"{delay} sample{'s' if delay != 1 else ''} later" if delay else "at the same sample"
    words = Words(
        title=f"Simulation of\n{model}"
        + (f"\n{named.replace(' for ', ' stands for ', 1)}." if named else ""),
        step=f"The newest {', '.join(model.inputs)}; return {model.outputs[0]} {when}.",
        reset=f"Rest: {model.outputs[0]} (m) and {', '.join(model.inputs)} have been held at these values.",
    )
    return written(law, name, words)


def simulation_law(model: NARXModel) -> tuple[CompensationLaw, int]:
    """Return the law that simulates a model, and the least lag of its inputs.

    Raises
    ------
    ValueError
        If the model has several outputs, no input or functions of the user's.
    """
    of_user = [str(p.name) for p in model.phi if isinstance(p, FunctionPhi)]
    if of_user:
        raise ValueError(
            f"{of_user} are functions of yours, of which there is no C. Identify the model without them, or "
            "compute them outside and pass them as inputs."
        )
    model, first, output = signals_of(model, None)
    renamed = letters_of(model, {output: INPUT, first: REFERENCE})
    side = with_letters(model.equation(), renamed)
    used = [p for p in model.phi if p.name in model.library.signals]
    elements = tuple(element_of(p, renamed, least_lag(side, renamed(str(p.name)))) for p in used)
    own = {INPUT, *(str(e.name) for e in elements if e.signal == INPUT)}
    lags = [v.lag for v in side.variables if v.signal not in own]
    delay = min(lags, default=0)
    moved = {v: v if v.signal in own else v.shift(-delay) for v in side.variables}
    equation = side.substitute({old: Polynomial.variable(new) for old, new in moved.items() if old != new})
    others = tuple(renamed(name) for name in model.inputs if name != first)
    return CompensationLaw("explicit", (equation,), elements, others=others), delay
