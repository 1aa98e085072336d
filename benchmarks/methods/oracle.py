"""The oracle: it is told the true terms and only estimates their parameters.

Least squares where the noise is in the equation; least free-run error where it is on the output. Signals are
standardised inside: the true structure of the physical system is the same in any unit and origin.
"""

import numpy as np
from harness.candidates import LibrarySpec
from harness.polynomial import PlainModel, fit_free_run, fit_least_squares, term_text


class Oracle:
    """The true structure with estimated parameters, and how well each is separated from zero."""

    def __init__(self, X: np.ndarray, y: np.ndarray, spec: LibrarySpec):
        self.u_scale, self.y_scale = (X.mean(), X.std()), (y.mean(), y.std())
        if not spec.standardise:
            self.u_scale = self.y_scale = (0.0, 1.0)
        estimate = fit_free_run if spec.noise_on_output else fit_least_squares
        theta, t_values = estimate(spec.true_terms, self._scaled_u(X), self._scaled_y(y))
        self.model = PlainModel(spec.true_terms, theta)
        self.terms = tuple(term_text(term) for term in spec.true_terms)
        self.smallest_t = float(t_values.min())

    def _scaled_u(self, u: np.ndarray) -> np.ndarray:
        return (u - self.u_scale[0]) / self.u_scale[1]

    def _scaled_y(self, y: np.ndarray) -> np.ndarray:
        return (y - self.y_scale[0]) / self.y_scale[1]

    def predict(self, X: np.ndarray, y_init: np.ndarray) -> np.ndarray:
        """Simulate from the initial outputs."""
        run = self.model.predict(self._scaled_u(X), self._scaled_y(y_init))
        return run * self.y_scale[1] + self.y_scale[0]


RECOVERERS = {"oracle": Oracle}
