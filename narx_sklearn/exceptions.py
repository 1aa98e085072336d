"""Warnings and errors that carry the number and the way out."""


class NarxWarning(UserWarning):
    """Base of the warnings of this package, for one filter over all of them."""


class DivergenceWarning(NarxWarning, RuntimeWarning):
    """A free run left the finite range; the message says at which sample."""


class RankWarning(NarxWarning, RuntimeWarning):
    """Regressors are collinear to rounding; the message says which were left out."""


class ExcitationWarning(NarxWarning):
    """The record cannot support what was asked of it (constant input, too few samples)."""


class ModelFormatError(ValueError):
    """A saved model is malformed or of an unknown version."""
