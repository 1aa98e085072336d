"""Simulators without equations: ``trace``, ``blackbox`` and ``fmu``.

A ``twin`` stands in for each: ``motion`` or ``stores``, fitted by ``trace_fit``, or a ``narx_simulator``.
"""
