"""What the displays of a model share: they can be drawn from the estimator that holds it."""


class ModelDisplay:
    """A display with a ``from_model``."""

    @classmethod
    def from_estimator(cls, estimator, *arguments, **options):
        """Compute and draw for the model of a fitted estimator.

        Parameters
        ----------
        estimator : estimator
            Fitted, with a NARXModel in ``model_``, such as NARXRegressor.
        *arguments, **options
            What ``from_model`` takes after the model.

        Returns
        -------
        display : object
            The display, drawn.

        Raises
        ------
        TypeError
            If the estimator holds no model.
        """
        model = getattr(estimator, "model_", None)
        if model is None:
            raise TypeError(
                f"{type(estimator).__name__} holds no model_; fit it first, or give from_model a NARXModel."
            )
        return cls.from_model(model, *arguments, **options)  # type: ignore[attr-defined] # of the display
