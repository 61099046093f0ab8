"""Work off the event loop.

- ``worker_pool``, ``scheduling``: bounded threads. ``shared_results``: work once for all callers.
- ``limited_process``: parsers of files from strangers, in child processes with limits.
- ``supervisor``, ``worker_reports``: several processes (``--workers``).
- ``process_tuning``: allocator, sockets, garbage collection.
"""
