"""Tests draw the same examples every time: a red test is red for everybody.

A file run by itself draws the first 25 examples of each law, so that it answers within a second;
``make test`` and CI draw 100, by ``--hypothesis-profile thorough``.
"""

from hypothesis import settings

settings.register_profile("thorough", derandomize=True, deadline=None)
settings.register_profile("quick", parent=settings.get_profile("thorough"), max_examples=25)
settings.load_profile("quick")
