"""Parsers of untrusted files. ``gateway.runtime.workers.limited_process`` calls them in child processes with limits.

They import NumPy, msgspec and the package that reads a format, and nothing else of this project: a child process holds
no server. Results are structs of bytes (``mesh_data``). Expected errors are returned, not raised.
"""
