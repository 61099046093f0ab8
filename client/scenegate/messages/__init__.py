"""Messages of the tree viewer's protocol.

- ``geometry``, ``image_geometry``, ``mesh_file``: the definition of each type of geometry.
- ``field_kinds``, ``colors``: how the fields of geometries are written and read.
- ``changes``: changes of a request, and a record of published geometry.
- ``wire``: the LCM message, both ways; ``request_encoding``: requests and responses of a client.
"""
