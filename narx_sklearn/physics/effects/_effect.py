"""What a missing piece of physics is: an equation at a port, with parameters, signs, starts, look-alikes."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

PORTS = ("input", "state", "output")  # as a signal goes through a machine
PARAMETER = "parameter"  # of the simulator: where it stands in the equations, there it is another one
ARGUMENTS = ("none", "own", "position", "any")
MET_ON = ("anything", "motion", "surfaces", "levels")
SECONDS = (None, "input", "channel", "drive", "feed", "other", "alike")
MAX_PARAMETERS = 7  # of an entry; the simulators' kernel has room for more, which curves without a name take
MAX_MEMORY = 12  # states of one effect's own; those of a Prandtl-Ishlinskii effect are eleven


class EffectParameter(NamedTuple):
    """One parameter of an effect.

    The unit is a template: ``{port}`` stands for the unit of what is added to (an input, a state's rate, an
    output), ``{arg}`` for the unit of the argument, ``{second}`` for that of the second argument. At an input
    it may have one value always, ``at_input``.
    """

    name: str
    unit: str
    lower: float = -np.inf
    upper: float = np.inf
    at_input: float | None = None


BEGIN = EffectParameter("i", "-", -1.0, 1.0)  # where within its play a memory stands when a record begins
LACKING = EffectParameter("i", "-", -10.0, 10.0)  # share of the first value; 1 for from rest at zero


class Power(NamedTuple):
    """A law that goes as a power of its argument."""

    exponent: float
    odd: bool  # whether it changes its sign with the argument


class Name(NamedTuple):
    """What an effect is called, and what is said of it."""

    code: str
    title: str
    sentence: str


class PutOut(NamedTuple):
    """What makes the output of a controller arrive later than it is put out: a force, or a dead time."""

    force: Any = None  # like an effect's ``force``: what is added to it
    n_memory: int = 0  # states of its own, the first of which begins at what is put out, less what is lacking
    late: int | None = None  # index of the parameter that is the dead time


class Setting(NamedTuple):
    """What a record shows at one place: the material from which starting values are taken.

    All arrays have shape (n_samples,) and hold the samples of the fitting windows, in order of time.
    """

    argument: np.ndarray  # at an input or output port: the signal itself
    rate: np.ndarray  # d(argument)/dt
    own: np.ndarray  # at a state port its rate, beside an input in the unit of that; else the signal
    second: np.ndarray | None  # the second argument, when there is one
    time: np.ndarray  # seconds since the session began
    dt: float
    first: np.ndarray  # indices at which a session or a gap's other side begins
    # measured less simulated output, where the caller has it: frequencies show in it
    residual: np.ndarray | None = None
    innovations: np.ndarray | None = None  # what it would be without the noise's memory, at any output
    elapsed: np.ndarray | None = None  # seconds since the record of all sessions began
    turns: bool = True  # whether the argument may be an angle, in radians: after a turn all comes again


def at_least(n_parameters: int, index: int, least: float) -> np.ndarray:
    """Return limits of which one is the least value of a parameter."""
    limits = np.tile([-np.inf, np.inf], (n_parameters, 1))
    limits[index, 0] = least
    return limits


def at_most(n_parameters: int, index: int, most: float) -> np.ndarray:
    """Return limits of which one is the largest value of a parameter."""
    return -at_least(n_parameters, index, -most)[:, ::-1]


def no_start(setting: Setting) -> np.ndarray:
    """Return no starting value: the effect does not apply."""
    return np.empty((0, 0))


@dataclass(frozen=True, eq=False)
class Effect:
    """One entry of the catalogue.

    Parameters
    ----------
    code : str
        Short name, for lists and reports.
    title, sentence : str
        A title and one plain sentence for an engineer.
    equation : str
        The equation in the parameters' names; ``x`` is the argument, ``v`` its rate, ``s`` the port's signal.
    parameters : tuple of EffectParameter
        At most seven.
    starts : callable
        ``starts(setting) -> ndarray (n_starts, n_parameters)``: parameter values worth trying on these data,
        of an ordinary size; none when the effect cannot be told from nothing on them.
    limits : callable, optional
        ``limits(setting) -> ndarray (n_parameters, 2)``: between which its parameters mean on these data what
        they are called; beyond them it is another effect (a ripple of which the motion spans no whole
        period is a spring).
    force : callable, optional
        For a state port: ``force(argument, rate, own, second, time, step, z, theta, dz) -> float``, added to
        the state's rate; compiled by numba. It writes ``dz/dt`` (or the new ``z`` where ``jumps``).
    transform : callable, optional
        For an input or output port: ``transform(signal, second, dt, theta, first) -> ndarray``, the whole
        signal at once; ``first`` holds the indices where it begins anew.
    held : callable, optional
        The same for an input that is held from sample to sample, where it then changes between samples:
        ``held(signal, dt, theta, first) -> (mean, rise)``, its mean over each step, and by how much the
        straight line closest to it rises.
    handed_on : callable, optional
        For a state that only follows an input, as all other equations have it, and for the output of a
        controller among them; of what acts on no input, for what passes through a coupling. Like ``force``,
        what is added to it there; compiled by numba.
    put_out : PutOut, optional
        For the output of a controller among the equations alone: what is only late there is the same before
        an actuator. How the effect is built has no meaning there.
    following : callable, optional
        For the equation of such a state itself, or of one that follows others in the same way, like
        ``force``: how it follows. Where a memory begins and how the effect is built have no meaning there.
    factor : callable, optional
        For a parameter of the simulator: ``factor(second, theta) -> float``, by which it is multiplied
        wherever it stands in the equations and outputs; compiled by numba.
    curved : callable, optional
        The same for an output that is known in the middle and at the end of each step too, where it may jump:
        ``curved(signal, middle, end, dt, theta, first) -> (signal, middle, end)``, of a parabola a step.
    read_as : str
        Its equation where it acts in an output on one of several signals of which that is made, u, as a
        voltage depends on the way of a charge; empty where it does not.
    argument : {"none", "own", "position", "any"}
        What the force depends on at a state port: nothing; the port's own state; the position that goes with
        it (its integral where the equations have one, else the state itself); any state.
    second : {None, "input", "channel", "drive", "feed", "other", "alike"}
        Second argument: every input; every measured channel that the simulator does not use (and, where it
        has several drives, those of other axes); or what else drives the state equation, each in turn:
        nothing in particular (NaN), its inputs, its neighbours. A feed is nothing (NaN), or an input of the
        state equation that stands in the argument's place. At an output it may be every other signal that
        was recorded: inputs, and what other outputs show, of which this one is not made; or every one in a
        unit that measures the same, recorded or not.
    amplitude : int or None
        Index of the parameter that scales the whole effect; None when no parameter does.
    levels : tuple of int
        Indices of the parameters that are levels between which the signal is kept, whichever is the higher:
        a fit returns them in rising order.
    begin : int or None
        Index of the parameter that tells in which state its memory begins; like initial states it has no
        price where effects are compared.
    form : int or None
        Index of the parameter that leads from one way to build the same thing to another (a filter of parts,
        or of code): it makes an effect no less simple.
    choice : int or None
        Index of the parameter that is at one end of its range or at the other, and nothing in between: a fit
        leaves it where it is, and is tried from there with the other end.
    chosen : tuple of int
        Indices of the parameters to which the cost has no slope (thresholds of a switch): each is chosen
        among the values that a record tells apart between its limits, and pays for that; a fit leaves it
        where it is.
    spare : tuple of int
        Indices of the parameters that are zero where they do not pay for themselves.
    phase : int or None
        Index of the parameter that is a phase, half a turn of which turns the sign of the amplitude.
    references : tuple of int
        Indices of the parameters from which an argument is counted. Often the simulator's own parameters can
        do what another reference does; then it is zero.
    instants : tuple of int
        Indices of the two parameters that tell when something that happened once began, and how long it took:
        each is chosen among all samples. Its transform sees the whole record, from whose beginning both
        count.
    n_memory : int
        States of its own.
    jumps : bool
        Whether its states jump to their new value at each sample, as play operators do.
    after : bool
        Whether it is a hard limit: its force acts within each step, with a ``step`` of next to nothing, and
        then corrects the mean rate of the whole step; it has no states of its own.
    last : bool
        Whether its force answers all else that acts in its equation, as what holds a body at rest does, so
        that it is asked last.
    acts_in : callable, optional
        ``acts_in(theta) -> ((low, high), ...)``: between which values of its argument it acts, if it acts in
        some range only. Each end is a smooth function of the parameters, or infinite whatever they are.
    met_on : {"anything", "motion", "surfaces", "levels"}
        What it is met on: anything; what moves; surfaces that slide on each other, which no circuit has. At
        the state equation of something else it is odd there, and pays for that. An effect of levels is not
        tried on a speed, an angle, a temperature or a current.
    met_at : {None, "input", "output"}
        Where it is met, if not in state equations: there it is odd too (lost motion lies before a machine).
    is_offset : bool
        Whether it adds a constant, which at an input whose gain is the same everywhere is a load: there it is
        not tried.
    read_off : bool
        Whether starting values that need measured values read them off these alone, not off what a simulation
        leaves of them.
    onward : bool
        Whether what is lost at the port may go on to another state; the share is then a parameter of its own.
    lookalikes : tuple of str
        Codes it is easily confused with.
    holds : tuple of str
        Codes of the effects that it becomes at an edge of its parameters.
    same_law : tuple of str
        Codes of the effects whose law it is too, under the name that it has in other machines.
    form_of : str
        Code of the effect of which it is another form, and whose code findings give; empty for none. Which of
        the forms it is is no question of what is missing.
    in_coupling : Name, optional
        What it is called where two bodies are coupled by what passes through it, if that has another name.
    reach : int or None
        Index of the parameter that tells after how long a move all of its memory has slipped, in the
        argument's unit. Within a motion that goes further it is a body's friction, and has the name that its
        law has there; where it goes on over the whole motion it is a material's hysteresis.
    power : Power, optional
        The power of its argument that the law goes as, where it is that alone; a record that tells another
        power refutes it.
    separate_by : str
        The excitation that tells it apart.
    source : str
        Authors, year, equation.
    phi : callable, optional
        ``phi(theta, argument, dt) -> tuple of Phi``: its regressors in a NARX model, as functions of the
        signal named ``argument``: the measured signal itself at an input or output, and the position, so that
        rates become first differences, for forces that depend on a rate.
    narx_terms : str
        Which polynomial terms do it in a NARX model, where no phi regressor is needed.
    scan : callable, optional
        ``scan(setting, residual) -> (ndarray (n, n_parameters), n_tried)``: the parameter values that explain
        the residual best, of very many tried on it; for shapes that a few starts cannot hit.
    n_apart : int
        Of how many values the scan chooses that no fit reaches from each other: they pay as what is chosen
        among as many effects; 0 for values that a fit goes on from.
    valleys : int
        How many other values are tried round fitted ones, for an effect that holds and jumps, so that a fit
        stays near its start; 0 for none.
    argument_units : tuple of str
        Units one of which the argument must have where its unit is known (an angle); empty for any.
    native_units : tuple of str
        Units of an argument that tell the machines to which it belongs: there it goes before what it holds,
        also where its parameters cannot be told apart.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.physics.effects import CATALOGUE
    >>> saturation = CATALOGUE["input_saturation"]
    >>> saturation.ports, [parameter.name for parameter in saturation.parameters]
    (('input',), ['low', 'high', 'w'])
    >>> saturation.transform(np.array([-3.0, 0.5, 2.0]), None, 0.01, [-1.0, 1.5, 0.0], [0]).tolist()
    [-1.0, 0.5, 1.5]
    """

    code: str
    title: str
    sentence: str
    equation: str
    parameters: tuple[EffectParameter, ...]
    starts: Callable[[Setting], np.ndarray]
    limits: Callable[[Setting], np.ndarray] | None = None
    force: Any = None
    transform: Any = None
    held: Any = None
    curved: Any = None
    handed_on: Any = None
    put_out: PutOut | None = None
    following: Any = None
    factor: Any = None
    input_port: bool = True
    output_port: bool = True
    read_as: str = ""
    argument: str = "own"
    second: str | None = None
    amplitude: int | None = 0
    levels: tuple[int, ...] = ()
    begin: int | None = None
    form: int | None = None
    choice: int | None = None
    chosen: tuple[int, ...] = ()
    spare: tuple[int, ...] = ()
    phase: int | None = None
    references: tuple[int, ...] = ()
    instants: tuple[int, int] | tuple[()] = ()
    n_memory: int = 0
    jumps: bool = False
    after: bool = False
    last: bool = False
    acts_in: Callable[..., tuple[tuple[float, float], ...]] | None = None
    met_on: str = "anything"
    met_at: str | None = None
    is_offset: bool = False
    read_off: bool = False
    onward: bool = False
    lookalikes: tuple[str, ...] = ()
    holds: tuple[str, ...] = ()
    same_law: tuple[str, ...] = ()
    form_of: str = ""
    in_coupling: Name | None = None
    reach: int | None = None
    power: Power | None = None
    separate_by: str = ""
    source: str = ""
    phi: Any = None
    narx_terms: str = ""
    argument_units: tuple[str, ...] = ()
    native_units: tuple[str, ...] = ()
    scan: Any = None
    n_apart: int = 0
    valleys: int = 0

    @property
    def ports(self) -> tuple[str, ...]:
        """Kinds of port at which it can act."""
        at_signal = self.transform is not None
        acts = (at_signal and self.input_port, self.force is not None, at_signal and self.output_port)
        kinds = zip((*PORTS, PARAMETER), (*acts, self.factor is not None), strict=True)
        return tuple(kind for kind, can in kinds if can)

    @property
    def memoryless(self) -> bool:
        """Whether its force depends on the present values alone."""
        return self.n_memory == 0

    def __repr__(self) -> str:
        return f"Effect({self.code!r})"

    def __reduce__(self):
        from narx_sklearn.physics.effects import restore_effect

        return restore_effect, (self.code,) if is_built_in(self) else (self.code, self.__dict__.copy())


def is_built_in(effect: Effect) -> bool:
    """Tell whether the effect is one of the catalogue's own."""
    from narx_sklearn.physics.effects import BUILT_IN, CATALOGUE

    return effect.code in BUILT_IN and CATALOGUE[effect.code] is effect
