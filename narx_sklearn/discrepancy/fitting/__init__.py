"""The fit: ``refit`` fits a ``problem``, which is a simulator and a record in windows.

``start`` guesses initial states; ``acting`` tells what effects add along a run.
"""
