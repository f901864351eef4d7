"""Inputs of all kinds, most of them absurd: each is taken, or refused in one line, in bounded time and memory.

``kinds`` lists what is fed to what, ``court`` judges every input in a process of its own, ``campaign`` draws inputs and
counts. ``python -m tests.fuzz`` is the long run, ``test_short.py`` the short one of the suite.
"""
