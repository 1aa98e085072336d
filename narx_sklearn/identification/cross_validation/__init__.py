"""Cross-validation by free run: choices of lags, degree and size on held-out parts.

``folds`` are parts of a record, of which each is held out once; choices are ``judged`` there: the whole grid
by ``screening``, and the ``finalists`` as they will be fitted. ``racing`` leaves out what cannot win. A
choice at one of the ``edges`` of the grid is told.
"""
