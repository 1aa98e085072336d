"""The stages of a diagnosis, from the first fit to the verdict.

``diagnosis`` is the chain. ``beginning`` fits what the simulator has (``bounded``: within bounds that were
given; ``apart``: in each session by itself; ``between_samples``: inputs held or not), ``coloured_search``
looks for what it lacks, ``stretches`` (by ``trimmed``) and ``temporary`` (with ``in_sessions``) for what acts
for a while;
``judgement`` says what that comes to, with ``naming``, ``swaps`` and ``fading``, in ``plain`` numbers:
what speaks against names (``refuted``, beside their own ``forms``), what has none (``unnamed``,
``powers``, ``laws``; ``knots``, ``smooth``) and goes with it (``told_law``), which parameter is no constant
(``varying``), what follows no signal (``unforeseen``; ``foretold``), and whether the rest is noise
(``remainder``, ``followed``, ``pulse``).
"""
