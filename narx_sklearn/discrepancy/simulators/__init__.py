"""Simulators: ``ode`` has equations, which ``equations`` compiles; ``switches`` finds where they jump.
A user's function is one of many ``callables``, with what is ``held`` by objects and written in ``tables``.
What an output function makes of states is ``read_back``; ``accelerations`` are outputs that repeat a rate.

Every simulator is a ``simulator``, which the ``kernels`` run: functions are handed to them by their
``addresses``, effects at state equations in ``slots``; those at inputs and outputs are ``applied`` to the
signals there. ``linearise``, ``structure`` and ``windows`` ask it about itself: its slopes, what drives what,
how long it remembers, which ``sums`` its equations have of signals. ``varied`` lets a parameter depend on a
signal.
"""
