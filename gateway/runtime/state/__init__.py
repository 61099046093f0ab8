"""The persistent state: the live tree and the stereo cameras' parameters in one SQLite file.

``service``          opens the file, restores and stores
``database``         the file: lock, checks, tables as migrations
``group_commit``     one transaction for all changes since the last one, on a thread of its own
``tree_store``       the live tree as rows
``keys``             tree paths as database keys
``part_codec``       geometry and materials as bytes
``parameter_store``  the stereo cameras' parameters as rows
"""
