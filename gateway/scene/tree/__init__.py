"""A persistent tree of nodes with geometry and transforms, and the live tree.

- ``geometry``, ``materials``, ``transforms``: shapes and matrices as values.
- ``nodes``: the persistent tree. ``live``: the live tree and its feed of changes. ``labels``: numbers of its paths.
- ``timeline``: states over time, as an interface; ``gateway.replay`` has the kinds of it.
"""
