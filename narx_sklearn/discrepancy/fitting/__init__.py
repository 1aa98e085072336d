"""The fit: ``refit`` fits a ``problem``, which is a simulator and a record in windows.

``start`` guesses initial states, and ``sides`` looks elsewhere for those nobody measured; ``directions`` are
those in which parameters do something together, or nothing; ``acting`` tells what effects add along a run.
"""
