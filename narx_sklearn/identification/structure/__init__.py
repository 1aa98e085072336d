"""What terms a model may have, and what must hold of their parameters.

``candidates`` are all terms within lags and degree that a structure admits: that of ``hysteresis``, or an
``isolable`` one. ``constraints`` are linear equations between parameters.
"""
