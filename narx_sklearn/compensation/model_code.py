"""A model as C, to simulate it in a controller or another program: an observer, a virtual sensor."""

from narx_sklearn.compensation.c_terms import (
    advanced,
    check_identifier,
    expression,
    helpers,
    macro_of,
    state_size,
    window,
)
from narx_sklearn.model.narx import NARXModel
from narx_sklearn.model.phi import FunctionPhi
from narx_sklearn.model.terms import Variable

__all__ = ["least_delay", "model_c_source"]


def model_c_source(model: NARXModel, name: str = "model") -> str:
    """Return C99 source that simulates a model: ``<name>_state``, ``<name>_reset`` and ``<name>_step``.

    ``<name>_step`` takes the newest inputs and gives the outputs that follow from them: at the same sample
    where an input acts at once, else as many samples later as the least lag of the inputs says. One output is
    returned; several are written to an array, which is the last argument. ``<name>_reset`` holds outputs and
    inputs at values of yours, the model's steady state as a rule. What it computes are the numbers of
    `free_run`, with all digits of the parameters, and no more finite than these; an input that is not finite
    is taken as it was last, and counted. It allocates nothing and needs ``math.h`` only.

    Parameters
    ----------
    model : NARXModel
        The model.
    name : str, default="model"
        Prefix of all names; a C identifier.

    Returns
    -------
    str

    Raises
    ------
    ValueError
        If the model has no input or functions of the user's, or ``name`` is no identifier.

    See Also
    --------
    c_source : A compensation law as C.

    Examples
    --------
    >>> from narx_sklearn.compensation import model_c_source
    >>> from narx_sklearn.model import NARXModel
    >>> model = NARXModel.from_equations("heat[k] = 0.1*drive[k-2] + 0.9*heat[k-1]", inputs=["drive"])
    >>> for line in model_c_source(model, "oven").splitlines():
    ...     if "drive" in line and "heat" in line:
    ...         print(line)
     * heat[k] = 0.1*drive[k-2] + 0.9*heat[k-1]
    /* The newest drive; return heat 2 samples later. */
        S_heat(0) = 0.1*S_drive(0) + 0.9*S_heat(1);
    /* Rest: heat and drive have been held at these values. */
    """
    check_identifier(name)
    of_user = [str(p.name) for p in model.phi if isinstance(p, FunctionPhi)]
    if of_user:
        raise ValueError(
            f"{of_user} are functions of yours, of which there is no C. Identify the model without them, or "
            "compute them outside and pass them as inputs."
        )
    if not model.inputs:
        raise ValueError(
            "The model has no input, so all that it does depends on the outputs that it begins with; there "
            "is nothing that a step could take. Simulate it with free_run."
        )
    writer = _Writer(model)
    parts = [writer.header(), *helpers(writer.kinds), writer.step(), writer.reset()]
    return "\n".join(parts).replace("NAME", name)


def least_delay(model: NARXModel) -> int:
    """Return how many samples after an input the first output follows from it: the least lag of the inputs.

    Examples
    --------
    >>> from narx_sklearn.compensation.model_code import least_delay
    >>> from narx_sklearn.model import Difference, NARXModel
    >>> least_delay(NARXModel.from_equations("0.5*y[k-1] + u[k-3] + phi1[k-2]", phi=[Difference("u")]))
    2
    """
    fed_back = {*model.outputs, *(str(p.name) for p in model.phi if p.signals <= set(model.outputs))}
    lags = (v.lag for term in model.library for v in term.variables if v.signal not in fed_back)
    return min(lags, default=0)


class _Writer:
    """Puts the parts of a model into C.

    A row of the window holds the inputs of one sample and the outputs that follow from them, so that an
    input at lag `l` stands ``l - delay`` rows before the newest one.
    """

    def __init__(self, model: NARXModel):
        self.delay = least_delay(model)
        self.model = model = model.expanded()
        self.phi = [p for p in model.phi if p.name in model.library.signals]
        self.kinds = {p.kind for p in self.phi}
        of_outputs = [str(p.name) for p in self.phi if p.signal in model.outputs]
        self.fed_back = {*model.outputs, *of_outputs}
        variables = {v for term in model.library for v in term.variables}
        self.rows = max([1, *(self._row(v) for v in variables)]) + 1  # a difference reads the row before
        signals = (*model.outputs, *model.inputs, *(str(p.name) for p in self.phi))
        self.macro = {signal: macro_of(signal) for signal in signals}
        self.known = [f"known{i}" for i in range(len(model.inputs))]
        self.arguments = ", ".join(f"double {known}" for known in self.known)

    def _row(self, v: Variable) -> int:
        return v.lag - (0 if v.signal in self.fed_back else self.delay)

    def _read(self, v: Variable) -> str:
        return f"{self.macro[v.signal]}({self._row(v)})"

    def _phi(self, of_outputs: bool) -> list[str]:
        """Return the lines that advance the phi regressors of the outputs, or of the inputs."""
        lines = []
        for i, phi in enumerate(self.phi):
            if (phi.name in self.fed_back) == of_outputs:
                signal = self.macro[phi.signal]
                value = advanced(phi, i, f"{signal}(0)", f"{signal}(1)", f"s->z[{i}]")
                lines.append(f"    {self.macro[str(phi.name)]}(0) = {value};")
        return lines

    @property
    def _memory(self) -> int:
        return max(len(self.phi), 1)  # C has no empty arrays

    def header(self) -> str:
        told = "\n * ".join(str(self.model).splitlines())
        names = "\n".join(window(self.macro.values(), self.rows))
        return (
            f"/* Simulation of\n * {told}\n */\n#include <math.h>\n\n"
            f"#define NAME_ROWS {self.rows}\n#define NAME_CHANNELS {len(self.macro)}\n"
            f"#define NAME_OUTPUTS {len(self.model.outputs)}\n#define NAME_STATE {state_size(self.kinds)}\n"
            f"{names}\n\n"
            "typedef struct {\n"
            "    double w[NAME_ROWS][NAME_CHANNELS]; /* rows of signals, oldest first */\n"
            f"    double z[{self._memory}][NAME_STATE]; /* memory of the phi regressors */\n"
            "    unsigned long samples, not_finite; /* steps, and those with an input that was not */\n"
            "} NAME_state;\n"
        )

    def step(self) -> str:
        model = self.model
        later = f"{self.delay} sample{'s' if self.delay != 1 else ''} later"
        when = later if self.delay else "at the same sample"
        single = len(model.outputs) == 1
        gives = f"return {model.outputs[0]}" if single else f"write {', '.join(model.outputs)}"
        lines = [
            f"/* The newest {', '.join(model.inputs)}; {gives} {when}. */",
            f"double NAME_step(NAME_state *s, {self.arguments})"
            if single
            else f"void NAME_step(NAME_state *s, {self.arguments}, double outputs[NAME_OUTPUTS])",
            "{",
            "    int i, j;",
            "    for (i = 0; i < NAME_ROWS - 1; i++)",
            "        for (j = 0; j < NAME_CHANNELS; j++) s->w[i][j] = s->w[i + 1][j];",
            "    s->samples++;",
            f"    if ({' || '.join(f'!isfinite({known})' for known in self.known)}) s->not_finite++;",
        ]
        for signal, known in zip(model.inputs, self.known, strict=True):
            macro = self.macro[signal]
            lines.append(f"    {macro}(0) = isfinite({known}) ? {known} : {macro}(1);")
        lines += self._phi(of_outputs=False)
        outputs = [f"{self.macro[output]}(0)" for output in model.outputs]
        for output, read in zip(model.outputs, outputs, strict=True):
            lines.append(f"    {read} = {expression(model.equation(output), self._read)};")
        lines += self._phi(of_outputs=True)
        if single:
            lines.append(f"    return {outputs[0]};")
        else:
            lines += [f"    outputs[{i}] = {read};" for i, read in enumerate(outputs)]
        return "\n".join([*lines, "}", ""])

    def reset(self) -> str:
        model = self.model
        single = len(model.outputs) == 1
        given = ["output"] if single else [f"outputs[{i}]" for i in range(len(model.outputs))]
        declared = "double output" if single else "const double outputs[NAME_OUTPUTS]"
        signals = zip((*model.outputs, *model.inputs), (*given, *self.known), strict=True)
        lines = [
            f"/* Rest: {', '.join(model.outputs)} and {', '.join(model.inputs)} have been held at these "
            "values. */",
            f"void NAME_reset(NAME_state *s, {declared}, {self.arguments})",
            "{",
            "    int i, j;",
            f"    for (i = 0; i < {self._memory}; i++)",
            "        for (j = 0; j < NAME_STATE; j++) s->z[i][j] = 0.0;",
            "    for (i = 0; i < 2; i++) { /* the row before the newest, and the newest */",
            *(f"        {self.macro[signal]}(1 - i) = {value};" for signal, value in signals),
            "    }",
            *self._phi(of_outputs=False),
            *self._phi(of_outputs=True),
            "    for (i = 0; i < NAME_ROWS - 1; i++)",
            "        for (j = 0; j < NAME_CHANNELS; j++) s->w[i][j] = s->w[NAME_ROWS - 1][j];",
            "    s->samples = s->not_finite = 0;",
            "}",
            "",
            *(f"#undef {macro}" for macro in self.macro.values()),
        ]
        return "\n".join(lines) + "\n"
