"""Compiled kernels: those that the default settings need at the start, and others in the background.

- ``loading``: what the rest of the gateway calls.
- ``parts``: which kernels are compiled together.
- ``cache``, ``compile_process``: child processes compile them into the cache.
- ``progress``: how far that is, for people.
"""
