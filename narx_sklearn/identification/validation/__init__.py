"""What is told of a model that was fitted.

``told`` puts together what a fit knows of its parameters, from ``stretches`` of the record; ``residuals``
are what the model leaves, some clusters of its terms are ``spurious``, and ``at_rest`` it may drift where its
input stops.
"""
