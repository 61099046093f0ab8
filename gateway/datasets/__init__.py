"""Datasets: images of many scenes from many cameras, rendered on all cores of a machine or of a Ray cluster.

A ``job`` lists scene files (``scene_sources``) and their ``views``, some of which come from a file.

A sample is one view of one scene. ``run`` renders a job: it keeps the valid samples of the previous run (``resume``),
runs tasks for the others in worker processes (``local_tasks`` or ``ray_tasks``), appends finished samples to its
journal, and writes the manifest. A ``worker`` loads ``scenes`` and renders their images (``rendering``,
``measured_depth``). ``annotated_scene`` finds the ``objects`` of a scene with their models and ``classes``, and
``annotations`` their pixels in an image. ``check`` verifies a dataset. ``scenario`` draws scenes from a seed.
``scenegate.datasets.manifest`` defines the files of a dataset.
"""
