"""Datasets: many scenes from many cameras, rendered on all cores or on Ray, into one documented folder.

``run`` is the entry. It takes a ``job``, keeps the valid samples of a former run (``resume``), gives tasks to worker
processes (``local_tasks`` or ``ray_tasks``, each running ``worker``), appends finished samples to the ``journal`` and
writes the manifest. ``check`` verifies a dataset. The files' formats are in ``gateway.client.manifest``.
"""
