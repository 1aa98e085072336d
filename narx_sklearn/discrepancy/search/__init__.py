"""The search for what is missing: ``explain`` adds one effect after another.

``hypotheses`` of the catalogue at their ``places``, and ``unnamed`` laws, become columns of a ``bank``;
``detect`` tests whether anything is missing, ``ranking`` says what leads; that is fitted, from other
``valleys`` too, or by ``draws``, and is then a ``candidate``, also without some of its ``members``, what
swings with its ``harmonics``; ``confirm`` asks whether it is noise (``by_chance``, ``restricted``),
``lookalikes`` which is the likeliest and what else it could be, ``inference`` how sure that is.
"""
