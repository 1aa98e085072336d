"""The library of candidates that a recovery method selects from."""

from dataclasses import dataclass

from harness.polynomial import Term


@dataclass(frozen=True)
class LibrarySpec:
    """All products up to `degree` of the lagged outputs and inputs; a method keeps at most `max_terms`.

    The other fields are for the oracle, and `true_terms` also for a method that is said to be told the size.
    """

    output_lags: tuple[int, ...] = (1, 2, 3, 4, 5, 6)
    input_lags: tuple[int, ...] = (1, 2, 3, 4, 5, 6)
    degree: int = 3
    max_terms: int = 20
    true_terms: tuple[Term, ...] = ()
    noise_on_output: bool = False
    standardise: bool = False
