"""A pytest plugin with a running gateway, for users' own integration tests; see ``docs/testing.md``.

``plugin``   the fixture ``scenegate``
``gateway``  a gateway process and a pool of them
``publish``  one request to the tree viewer, with the standard library only
"""
