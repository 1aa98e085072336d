"""The free run, in which a model reads inputs and its own past outputs.

``free_run_fit`` has ``refinement`` fit parameters by it and ``simulation_search`` choose terms, and keeps
what they find where one-step errors show no ``whiteness``; ``sizes`` lets it choose how many terms. Free runs
are judged by ``scoring``; some are ``lost``, ``many`` go at the same time.
"""
