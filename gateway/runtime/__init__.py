"""The process around the interfaces.

``worker_pool`` and ``scheduling`` (work off the event loop), ``process_tuning`` (allocator, sockets, garbage collection),
``kernel_cache`` and ``kernel_progress`` (compiled kernels), ``service_registry`` (states of the interfaces),
``metrics_registry``, ``logs`` and ``recent_logs``, ``diagnostics`` and ``instance_probe`` (``scenegate check``).
"""
