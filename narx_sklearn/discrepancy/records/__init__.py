"""The record: ``record`` makes arrays of it.

What is wrong with it itself is a ``finding``. ``checks`` sees it by ``counts``, with ``jumps``, and by
``mistakes`` that are undone on trial, readings that are ``folded`` among them, and told ``in_words``;
``steps``, ``spikes`` and ``dead`` values are looked for apart. Which of them are ``standing`` beside the
physics that was found is asked at the end.
"""
