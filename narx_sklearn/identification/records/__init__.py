"""Records that are read block by block, wherever they are.

A ``record`` of arrays, ``recordings`` in files, and ``distributed`` ones on workers.
"""
