"""Settings of the whole test suite."""

from hypothesis import settings

# Derandomised, so that a run fails for a change and not for a draw; compiled kernels need no deadline.
# To look for new counterexamples: python -m pytest --hypothesis-profile=explore
settings.register_profile("law", deadline=None, derandomize=True, max_examples=40)
settings.register_profile("explore", deadline=None, max_examples=2000)
settings.load_profile("law")
