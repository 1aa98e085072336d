"""A compensation law as C: one self-contained program part for a controller."""

from narx_sklearn.compensation import _c_runtime as runtime
from narx_sklearn.compensation import _kernels as kernels
from narx_sklearn.compensation import _polynomial_roots as roots
from narx_sklearn.compensation.c_terms import (
    advanced,
    check_identifier,
    expression,
    filled,
    helpers,
    macro_of,
    number,
    state_size,
    window,
)
from narx_sklearn.compensation.law import BRANCHES, INPUT, REFERENCE, CompensationLaw, FunctionElement
from narx_sklearn.model.polynomials import Polynomial
from narx_sklearn.physics.boucwen import LONGEST_STEP, ROUNDING, SHORTEST_SHARE

__all__ = ["c_source"]

LETTERS = {INPUT: "M", REFERENCE: "R"}  # in C


def c_source(law: CompensationLaw, name: str = "compensator") -> str:
    """Return C99 source of a law: ``<name>_state``, ``<name>_reset`` and ``<name>_step``.

    The program part allocates nothing, needs ``math.h`` only, and computes the numbers of `LawState.step`:
    the same operations on double precision, in the same order but for sums of terms. The longest time of
    one step is that of one pass through its straight code; where roots are sought or searched, the
    iterations are bounded. Functions of the user's are declared as ``<name>_user_<phi>``, for the user to
    write in C.

    Parameters
    ----------
    law : CompensationLaw
        The law.
    name : str, default="compensator"
        Prefix of all names; a C identifier.

    Returns
    -------
    str

    Raises
    ------
    ValueError
        If ``name`` is no identifier.

    Examples
    --------
    >>> from narx_sklearn.compensation import CompensationLaw, c_source
    >>> from narx_sklearn.model import Polynomial
    >>> law = CompensationLaw("explicit", (Polynomial.parse("2*r[k+1] - r[k]"),))
    >>> "2.0*R(0) - R(1)" in c_source(law)
    True
    """
    check_identifier(name)
    writer = _Writer(law)
    parts = [writer.header(), writer.functions(), writer.elements(), writer.solver(), writer.step()]
    return "\n".join(part for part in parts if part).replace("NAME", name)


class _Writer:
    """Puts a law's own parts into C."""

    def __init__(self, law: CompensationLaw):
        self.law = law
        self.rows = law._back + 1
        self.present = self.rows - 1 - law.horizon
        self.macro = {signal: LETTERS.get(signal, macro_of(signal)) for signal in law.channels}
        self.functions_of_user = [e for e in law.elements if isinstance(e, FunctionElement)]

    def header(self) -> str:
        law = self.law
        text = "\n * ".join(str(law).splitlines())
        limits = [
            f"#define NAME_{key} {number(value)}"
            for key, value in (("LOW", law.limits[0]), ("HIGH", law.limits[1]), ("RATE", law.rate_limit))
        ]
        names = window(self.macro.values(), self.rows)
        width = state_size(e.kind for e in law.elements)
        return (
            f"/* Compensation law. The newest row (0) is k + {law.horizon}, the input wanted is m[k].\n"
            f" * {text}\n */\n#include <math.h>\n\n"
            f"#define NAME_ROWS {self.rows}\n#define NAME_CHANNELS {len(law.channels)}\n"
            f"#define NAME_DEGREE {max(law.degree, 1)}\n#define NAME_STATE {width}\n"
            f"#define NAME_NEAREST {int(law.policy == 'nearest')}\n"
            f"#define NAME_BRANCH ({BRANCHES[law.branch]})\n" + "\n".join(limits + names) + "\n\n"
            "typedef struct {\n"
            "    double w[NAME_ROWS][NAME_CHANNELS]; /* rows of signals, oldest first */\n"
            f"    double z[{max(len(law.elements), 1)}][NAME_STATE]; /* memory of the elements */\n"
            "    unsigned long samples, no_solution, at_limit, at_rate_limit;\n"
            "} NAME_state;\n"
        )

    def functions(self) -> str:
        kinds = {e.kind for e in self.law.elements}
        constants = {
            "GRAZE": roots.GRAZE,
            "TIGHT": roots.TIGHT,
            "WIDEST": roots.WIDEST,
            "ALIKE": roots.ALIKE,
            "FEW_ITERATIONS": roots.FEW_ITERATIONS,
            "LONGEST_STEP": LONGEST_STEP,
            "SHORTEST_SHARE": SHORTEST_SHARE,
            "ROUNDING": ROUNDING,
        }
        chosen = helpers(kinds)
        chosen += [runtime.BETTER] if self.law.method in ("roots", "search") else []
        chosen += [runtime.ROOTS] if self.law.method == "roots" else []
        return filled("\n".join(chosen), constants)

    def _set(self, of_input: bool, back: int) -> list[str]:
        """Return the lines that advance the elements of the input, or of the known signals, at one row."""
        lines = []
        for p, element in enumerate(self.law.elements):
            if not isinstance(element, FunctionElement) and (element.signal == INPUT) == of_input:
                source, target = self.macro[element.signal], self.macro[str(element.name)]
                value = advanced(element, p, f"{source}({back})", f"{source}({back + 1})", f"s->z[{p}]")
                lines.append(f"    {target}({back}) = {value};")
        return lines

    def _call_functions(self) -> list[str]:
        """Return the lines that write the values of the user's functions at the row of m[k]."""
        h = self.law.horizon
        lines = []
        for element in self.functions_of_user:
            arguments = ", ".join(f"{self.macro[v.signal]}({v.lag + h})" for v in element.of)
            lines.append(f"    {self.macro[element.name]}({h}) = NAME_user_{element.name}({arguments});")
        return lines

    def elements(self) -> str:
        lines = [
            f"static const double NAME_p{i}[] = {{{', '.join(map(number, e.kernel_parameters))}}};"
            for i, e in enumerate(self.law.elements)
            if e.kind == kernels.BOUC_WEN
        ]
        for e in self.functions_of_user:
            arguments = ", ".join(["double"] * len(e.of))
            lines.append(f"double NAME_user_{e.name}({arguments}); /* yours: {e.describe()} */")
        return "\n".join(lines) + "\n" if lines else ""

    def expression(self, polynomial: Polynomial) -> str:
        """Return a polynomial as an expression of the window's macros."""
        h = self.law.horizon
        return expression(polynomial, lambda v: f"{self.macro[v.signal]}({v.lag + h})")

    def solver(self) -> str:
        law = self.law
        if law.method == "explicit":
            return (
                "static double NAME_solve(NAME_state *s, double previous, int *found)\n{\n"
                "    (void)previous;\n    *found = 1;\n"
                f"    return {self.expression(law.equations[0])};\n}}\n"
            )
        if law.method == "search":
            at = law.horizon
            memory = any(e.has_memory for e in law.elements if e.signal == INPUT)
            lines = ["static double NAME_residual(NAME_state *s, double m)", "{"]
            lines += ["    double z[NAME_STATE];", "    int i;"] if memory else []
            lines.append(f"    {self.macro[INPUT]}({at}) = m;")
            lines += self._call_functions()
            for p, element in enumerate(law.elements):
                if not isinstance(element, FunctionElement) and element.signal == INPUT:
                    if element.has_memory:
                        lines.append(f"    for (i = 0; i < NAME_STATE; i++) z[i] = s->z[{p}][i];")
                    target = self.macro[str(element.name)]
                    source = self.macro[INPUT]
                    value = advanced(element, p, f"{source}({at})", f"{source}({at + 1})", "z")
                    lines.append(f"    {target}({at}) = {value};")
            lines += [f"    return {self.expression(law.equations[0])};", "}", ""]
            constants = {name: getattr(kernels, name) for name in ("FIRST_STEP", "GROWTH", "VANISHES")}
            return "\n".join(lines) + "\n" + filled(runtime.SEARCH, constants)
        return self._root_solver()

    def _root_solver(self) -> str:
        law = self.law
        n = law.degree + 1
        lines = ["static double NAME_solve(NAME_state *s, double previous, int *found)", "{"]
        lines.append("    double up[NAME_DEGREE + 1], down[NAME_DEGREE + 1];")
        for i in range(n):
            lines.append(f"    up[{i}] = {self.expression(law.equations[i])};")
        for i in range(n):
            text = self.expression(law.equations[(law.n_regimes - 1) * n + i])
            lines.append(f"    down[{i}] = {'-(' + text + ')' if i % 2 else text};")
        if law.n_regimes == 1:
            lines += [
                "    *found = 1;",
                "    if (up[0] == 0.0 && NAME_LOW <= previous && previous <= NAME_HIGH) return previous;",
            ]
        lines += ["    return NAME_nearest_root(up, down, previous, found);", "}", ""]
        return "\n".join(lines)

    def step(self) -> str:
        law, h = self.law, self.law.horizon
        m = self.macro[INPUT]
        n_known = len(law.known)
        missing = " || ".join(f"!isfinite(known{i})" for i in range(n_known))
        rest = ""
        if law.keeps_rest:
            known = [self.macro[signal] for signal in law.known]
            same = " && ".join(f"{s}({i}) == {s}(0)" for s in known for i in range(1, law._known_reach + 1))
            rest = f"    if ({same}) m = previous;\n    else\n"
        arguments = ", ".join(f"double known{i}" for i in range(n_known))
        lines = [
            f"/* The newest known signals ({', '.join(law.known)}, at k + {h}), return m[k]. */",
            f"double NAME_step(NAME_state *s, {arguments})",
            "{",
            "    double m, limited, previous;",
            "    int i, j, found = 1;",
            "    for (i = 0; i < NAME_ROWS - 1; i++)",
            "        for (j = 0; j < NAME_CHANNELS; j++) s->w[i][j] = s->w[i + 1][j];",
            *(
                f"    {self.macro[s]}(0) = isfinite(known{i}) ? known{i} : {self.macro[s]}(1);"
                for i, s in enumerate(law.known)
            ),
            *self._set(False, 0),
            *([] if law.method == "search" else self._call_functions()),
            f"    previous = {m}({h + 1});",
            "    s->samples++;",
            f"{rest}    m = NAME_solve(s, previous, &found);",
            "    if (!found && !NAME_NEAREST) m = previous;",
            f"    if (!found || !isfinite(m) || {missing}) s->no_solution++;",
            "    if (!isfinite(m)) m = previous;",
            "    limited = fmin(fmax(m, NAME_LOW), NAME_HIGH);",
            "    if (limited != m) s->at_limit++;",
            "    m = fmin(fmax(limited, previous - NAME_RATE), previous + NAME_RATE);",
            "    if (m != limited) s->at_rate_limit++;",
            f"    {m}({h}) = m;",
            *self._set(True, h),
            *(self._call_functions() if law.method == "search" else []),
            "    return m;",
            "}",
            "",
            "/* Rest: input and known signals have been held at these values. */",
            f"void NAME_reset(NAME_state *s, double m, {arguments})",
            "{",
            "    int i, j;",
            "    for (i = 0; i < NAME_ROWS; i++) {",
            "        for (j = 0; j < NAME_CHANNELS; j++) s->w[i][j] = 0.0;",
            "        s->w[i][0] = m;",
            *(f"        s->w[i][{1 + i}] = known{i};" for i in range(n_known)),
            "    }",
            f"    for (i = 0; i < {max(len(law.elements), 1)}; i++)",
            "        for (j = 0; j < NAME_STATE; j++) s->z[i][j] = 0.0;",
        ]
        for p, element in enumerate(law.elements):
            if isinstance(element, FunctionElement):
                continue
            initial = law.initial_states.get(str(element.name))
            if initial is not None:
                lines.append(f"    s->z[{p}][0] = {number(initial)};")
            source, target = self.macro[element.signal], self.macro[str(element.name)]
            value = advanced(element, p, f"{source}(0)", f"{source}(0)", f"s->z[{p}]")
            lines.append(f"    {target}(0) = {value};")
            lines.append(f"    for (i = 1; i < NAME_ROWS; i++) {target}(i) = {target}(0);")
        lines += self._call_functions()
        for element in self.functions_of_user:
            target = self.macro[element.name]
            lines.append(f"    for (i = 0; i < NAME_ROWS; i++) {target}(i) = {target}({h});")
        lines += ["    s->samples = s->no_solution = s->at_limit = s->at_rate_limit = 0;", "}", ""]
        lines += [f"#undef {macro}" for macro in self.macro.values()]
        return "\n".join(lines) + "\n"
