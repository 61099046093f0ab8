"""The scene graph that all interfaces share. It has no protocol, no transport and no event loop.

- ``tree``: nodes with geometry and transforms, the live tree, states over time.
- ``draw``: draw lists, cameras and bounds of a tree.
- ``page``: settings, clicks and controls of the page in the browser.
"""
