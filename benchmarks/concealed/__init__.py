"""The protocol that proves a diagnosis: concealed effects, sealed truths, blind verdicts, a score.

``make`` and ``plants`` import nothing of the package under test. See README.md in this folder.
"""
