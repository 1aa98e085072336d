"""Laws without a name: what physics outside the catalogue would look like.

``kinds`` says which there are and what is told of each. Most are ``linear`` in their coefficients: ``curves``
of a signal (a ``broken_line``) at every port, and ``polynomials`` in position and rate where something moves;
``proportions`` of a signal that act for a while or by turns, ``powers``, ``products`` of two signals,
``ripples`` of a gain, ``radiation`` of heat, a force near ``one_place`` or from there on, what damps
``beyond_a_gap``. In a ``storage`` an inertia or capacity changes, ``varying`` a parameter; ``memories`` are
at inputs and outputs, ``switches`` go over at one threshold and back at another, ``by_rate`` a reading is
off. When one explains clearly more than any of the names, something is missing that has none, and its law is
already there.
"""
