"""References that ask for more than the model's record has shown: farther, or faster."""

import numpy as np

__all__ = ["beyond_record"]

CLEARLY = 0.1  # of the recorded range, or of the largest change: so much beyond is no rounding and no noise


def beyond_record(reference, shown=None, change=None) -> str:
    """Say where a reference goes clearly farther, or changes clearly faster, than a record showed.

    A model is a polynomial through what was recorded: beyond, it may go anywhere, and so may its law.

    Parameters
    ----------
    reference : array-like of shape (n_samples,)
        Reference, in the unit of the output.
    shown : (float, float, float) or None, default=None
        Least, mean and largest output of the record (``model.recorded``); None where that is not known.
    change : float or None, default=None
        Its largest change from one sample to the next (``model.recorded_change``).

    Returns
    -------
    str
        What came, what the record showed, and the way out; empty where the reference keeps within.

    Examples
    --------
    >>> from narx_sklearn.compensation.beyond import beyond_record
    >>> beyond_record([0.0, 0.5, 1.05], (0.0, 0.4, 1.0), 0.5)
    ''
    >>> beyond_record([0.0, 0.5, 1.2], (0.0, 0.4, 1.0), 0.8)[:80]
    'The reference goes to 1.2 at sample 2, where the record showed an output from 0 '
    >>> beyond_record([0.0, 0.5, 1.0], (0.0, 0.4, 1.0), 0.2)[:70]
    'The reference changes by 0.5 in one sample, at sample 1, where the rec'
    """
    r = np.asarray(reference, dtype=float)
    found, ways, as_what = [], [], []
    if shown is not None:
        low, _, high = shown
        far = np.maximum(r - high, low - r)
        k = int(np.argmax(far))
        if far[k] > CLEARLY * (high - low):
            found.append(
                f"goes to {r[k]:.4g} at sample {k}, where the record showed an output from {low:.4g} to "
                f"{high:.4g}"
            )
            ways.append("keep it within")
            as_what.append("far")
    steps = np.abs(np.diff(r))
    fast = np.zeros(steps.size, dtype=bool) if change is None else steps > (1.0 + CLEARLY) * change
    if fast.any():
        k = int(np.argmax(steps))
        found.append(
            f"changes by {steps[k]:.4g} in one sample, at sample {k + 1}, where the record's output changed "
            f"by at most {change:.4g}, and is faster than that at {fast.sum()} of {r.size} samples"
        )
        ways.append("slow it down")
        as_what.append("fast")
    if not found:
        return ""
    return (
        f"The reference {', and '.join(found)}. Of what the machine does there the model knows nothing, and "
        f"the law may go astray. {' and '.join(ways).capitalize()}, or identify the model from a record that "
        f"goes as {' and as '.join(as_what)}."
    )
