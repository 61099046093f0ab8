"""Messages of the tree viewer's protocol.

- ``geometry``, ``image_geometry``, ``mesh_file``, ``colors``: geometry that can be published.
- ``changes``: changes of a request, and a record of published geometry.
- ``wire``: encoding of requests and responses.
"""
