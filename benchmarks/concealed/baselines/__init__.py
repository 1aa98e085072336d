"""Other ways to the same end, on the same cases: one module a method, each with a ``run(case)`` function."""
