"""The process around the interfaces.

- ``worker_pool``, ``scheduling``: work off the event loop. ``shared_results``: work once for all callers.
- ``process_tuning``: allocator, sockets, garbage collection.
- ``kernels``: compiled kernels.
- ``service_registry``: states of the interfaces. ``supervisor``, ``worker_reports``: several processes (``--workers``).
- ``metrics_registry``, ``render_record``, ``logs``, ``recent_logs``: what the process reports.
- ``limited_process``: parsers of files from strangers.
- ``diagnostics``, ``instance_probe``: ``scenegate doctor``.
"""
