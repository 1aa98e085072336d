"""The record: ``record`` makes arrays of it.

What is wrong with it itself is seen by ``checks`` (``mistakes`` are undone on trial), ``steps``, ``jumps``,
``spikes`` and ``dead`` values.
"""
