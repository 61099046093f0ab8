"""The shared core: a tree of frames and shapes, its live instance, the glTF reader, flattening to a draw list.

Knows no protocol, no transport and no event loop.
"""
