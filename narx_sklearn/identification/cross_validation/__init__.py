"""Cross-validation by free run: choices of lags, degree and size on held-out parts.

``folds`` are parts of a record, of which each is held out once; choices are ``judged`` there, in a ``race``:
all of them by a ``screen`` of least squares, and the ``finalists`` as they will be fitted.
"""
