"""The process around the adapters.

- ``http``: the HTTP edge. ``lcm``: the TCPQ hub.
- ``workers``: work off the event loop, in threads and child processes; several processes (``--workers``).
- ``kernels``: compiled kernels. ``state``: the tree and parameters in a file (``--state``). ``settings``: every option.
- ``logs``: what the process reports. ``service_registry``: states of the interfaces.
- ``diagnostics``, ``instance_probe``: ``scenegate doctor``.
"""
