"""Director's remote tree viewer: requests over LCM become edits of the live tree, and each gets a response.

The path of a request through the files:

- ``service``: receives it from a transport (``gateway.lcm``) and passes it to ``dispatch``.
- ``dispatch``: handles it at once, or in a worker thread if it is big; ``client_queue`` keeps the order of each client,
  ``delayed_responses`` holds back responses that Director's client would lose.
- ``protocol``: the protocol without I/O. ``wire`` decodes the message, ``json_reader`` or ``msgpack_reader`` its data.
- ``request_reader``: turns decoded data into a ``requests.Request``, by ``fast_schema`` for the most frequent commands,
  else by ``fields``, ``geometry`` and ``array_geometry``, which tolerate the clients' oddities and give reasons.
- ``number_arrays``, ``json_kernels``, ``packed_arrays``, ``msgpack_kernels``: long arrays in JSON and MessagePack.
- ``apply``: executes the request on the tree within the limits of ``quota``; ``responses``: what the client receives.
"""
