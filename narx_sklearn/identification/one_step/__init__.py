"""One step ahead: terms and parameters by least squares on a triangular factor of the record.

A ``procedure`` has steps: ``compression`` of the ``regressors`` into a ``factor``, after the ``screening`` of
many by their inner ``_products``; ``selection`` on it, by ``criteria``; ``estimation``, also ``extended`` by
terms of noise, and the ``uncertainty`` of what was estimated.
"""
