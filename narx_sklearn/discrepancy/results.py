"""What a diagnosis says, as values."""

from dataclasses import dataclass

import numpy as np

from narx_sklearn.model.units import in_seconds

VERDICTS = {
    "consistent": "The simulation agrees with the recordings; nothing is missing that these data can show.",
    "refit": "No physics is missing; the simulation's parameters are off.",
    "explained": "Physics is missing, and these recordings say which.",
    "ambiguous": "Physics is missing; these recordings cannot tell some explanations apart.",
    "unknown": "Physics is missing that the catalogue does not hold.",
}
CHANGES = "A parameter of the simulation is not always the same"  # which no effect of the catalogue does
DISTURBED = "Something acts on the machine that follows none of its signals"

NOTHING_MISSING = ("consistent", "refit")
BY_SESSION = "by session"  # score of the simulation with parameters of their own in sessions

LEAST = 1e-12  # p-values below say no more than that
STANDS_IN = 1.5  # times what names leave where they were fitted, that they leave elsewhere if they stand in


def p_text(p: float, relation: str = "= ") -> str:
    """Return a p-value, two digits, after what stands before it in a sentence (nothing in a table).

    One that is not known is a dash in a table, as any number.

    Examples
    --------
    >>> from narx_sklearn.discrepancy.results import p_text
    >>> p_text(2.704e-07), p_text(2.704e-07, ""), p_text(0.0, "")
    ('= 2.7e-07', '2.7e-07', '< 1e-12')
    >>> p_text(float("nan")), p_text(float("nan"), "")
    ('not known', '-')
    """
    if np.isnan(p):
        return "not known" if relation else "-"
    return f"{relation}{p:.2g}" if p >= LEAST else f"< {LEAST:.0e}"


@dataclass(frozen=True)
class Finding:
    """One effect found missing.

    Parameters
    ----------
    effect, title, sentence, equation : str
        Entry of the catalogue.
    port : str
        Where it enters, ``"state:1"``.
    place : str
        The same in words.
    argument : str
        The signals it depends on, with units, by their letters in the equation: ``"v = rate [m/s]"``; empty
        where the equation has none.
    parameters : dict
        Values by name.
    intervals : dict
        Their confidence intervals.
    units : dict
        Their units.
    lookalikes : tuple of str
        Codes of the effects that explain these data about as well.
    p_value : float
        Of the test that something is missing, adjusted for everything that was tried.
    improvement : float
        Share of the fitting windows' squared error that the whole set takes away.
    separate_by : str, default=""
        What experiment tells it from its look-alikes; where it has no form, what would tell more.
    rivals : tuple of str, default=()
        The look-alikes and their places, in words.
    elsewhere : tuple of str, default=()
        Other places, in words, where the same effect fits these data as well.
    confidence : float, default=0.0
        Weight of this effect among all that were tried in its place.
    during : tuple of (float, float), default=None
        Seconds since the session began, of each where there are several, between which it acts; None where it
        always does. Where it acts ``in_sessions``, seconds along the whole record.
    in_sessions : str, default=""
        In which sessions it acts, in words; empty where it acts alike in all.
    evidence : dict, default=None
        Numbers behind it; for what is no noise but has no form, the p-values of what speaks against noise:
        ``"follows"`` the motion, its ``"size"`` does, ``"bursts"``, a ``"line"``,
        a ``"pulse"``, that outputs go ``"together"``, or that something ``"unforeseen"`` acts.
    untold : tuple of str, default=()
        Names of its parameters of which these data tell nothing: any value that they may have is as likely.
    together : tuple of str, default=()
        Names of those of which these data tell only what they do together: of a slow drift its size and its
        time constant, where its slope is all that shows.
    adds : tuple of (float, float), default=None
        The least and the most that it adds along the samples fitted; None where that is not known.
    adds_to : str, default=""
        What that is added to, its unit before it: ``"m/s^2 added to the rate of velocity"``.
    where : str, default=""
        Where it acts, if that is where a signal is beyond or between values that it came to:
        ``"position is above 0.54 m"``; empty where it acts anywhere.
    stands : bool, default=True
        False where it comes nearest to what is missing but does not explain it: the verdict is *unknown*.
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
    elsewhere: tuple[str, ...] = ()
    confidence: float = 0.0
    during: tuple[float, float] | None = None
    in_sessions: str = ""
    evidence: dict | None = None
    untold: tuple[str, ...] = ()
    together: tuple[str, ...] = ()
    adds: tuple[float, float] | None = None
    adds_to: str = ""
    where: str = ""
    stands: bool = True

    @property
    def size(self) -> str:
        """How large it is, "Along this record: 0 to 0.3 m added to position."; empty where not known."""
        if self.adds is None:
            return ""
        low, high = self.adds
        where = f", where {self.where}" if self.where else ""
        return f"Along this record: {low + 0.0:.3g} to {high + 0.0:.3g} {self.adds_to}{where}."  # no -0

    @property
    def when(self) -> str:
        """When it acts: "" (always), ", from 3 s to 7.5 s", ", from 3 s on", ", in session 2"."""
        if self.during is None:
            return ""
        if self.in_sessions:
            return f", {self.in_sessions}"
        begins, ends = self.during
        if not np.isfinite(begins):
            return f", until {in_seconds(ends)}"
        begins_at = f", from {in_seconds(begins)}"
        return f"{begins_at} on" if not np.isfinite(ends) else f"{begins_at} to {in_seconds(ends)}"

    @property
    def modelled(self) -> bool:
        """Whether it has a form: an equation, or parameters.

        The corrected simulation holds it then, unless held-out samples speak against it or nobody can foresee
        its course.
        """
        return bool(self.equation or self.parameters)
