"""Datasets: many scenes from many cameras, rendered on all cores or on Ray, into one documented folder.

``run`` is the entry: it renders a ``job``, the ``views`` of the scenes in its ``sources``. It keeps the valid samples
of a former run (``resume``), runs tasks for the others in worker processes (``local_tasks`` or ``ray_tasks``), appends
finished samples to the ``journal``, and writes the manifest. A ``worker`` loads ``scenes`` and renders images
(``rendering``). ``check`` verifies a dataset. The formats of the files are in ``gateway.client.manifest``.
"""
