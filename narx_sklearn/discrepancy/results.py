"""What a diagnosis says, as values."""

from dataclasses import dataclass, field

VERDICTS = {
    "consistent": "The simulation agrees with the recordings; nothing is missing that these data can show.",
    "refit": "No physics is missing; the simulation's parameters are off.",
    "explained": "Physics is missing, and these recordings say which.",
    "ambiguous": "Physics is missing; these recordings cannot tell some explanations apart.",
    "unknown": "Physics is missing that the catalogue does not hold.",
}


@dataclass(frozen=True)
class Finding:
    """One effect found missing.

    Attributes
    ----------
    effect, title, sentence, equation : str
        Entry of the catalogue.
    port : str
        Where it enters, ``"state:1"``; ``place`` says it in words.
    argument : str
        The signal it depends on, with unit.
    parameters, intervals, units : dict
        Values by name, their confidence intervals, their units.
    lookalikes : tuple of str
        Codes of the effects that explain these data about as well.
    rivals : tuple of str
        The same with their places, ``"code at port"``.
    p_value : float
        Of the test that something is missing, adjusted for everything that was tried.
    improvement : float
        Share of the fitting windows' squared error that it takes away.
    confidence : float
        Weight of this effect among all that were tried in its place.
    separate_by : str
        What experiment tells it from its look-alikes.
    evidence : dict
        Numbers behind it.
    """

    effect: str
    title: str
    sentence: str
    equation: str
    port: str
    place: str
    argument: str
    parameters: dict
    intervals: dict
    units: dict
    lookalikes: tuple[str, ...]
    p_value: float
    improvement: float
    separate_by: str = ""
    rivals: tuple[str, ...] = ()
    confidence: float = 0.0
    evidence: dict = field(default_factory=dict)
