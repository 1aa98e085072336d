"""Simulators: ``ode`` has equations, which ``equations`` compiles; ``switches`` finds where they jump.

Every simulator is a ``simulator``, which the ``kernels`` run. ``linearise``, ``structure`` and ``windows``
ask it about itself: its slopes, what drives what, how long it remembers.
"""
