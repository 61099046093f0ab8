"""Director's remote tree viewer: LCM requests edit the live tree, and each request gets a response.

A request passes through the files in this order:

- ``service``: receives the request from a transport (``gateway.lcm``) and passes it to ``dispatch``.
- ``dispatch``: handles small regular requests at once and others in a worker thread. ``client_queue`` keeps each
  client's requests in order, ``delayed_responses`` holds back responses that Director's client would lose.
- ``protocol``: the protocol without I/O. ``wire`` decodes the message; ``json_reader`` or ``msgpack_reader`` decodes
  the data in the message.
- ``request_reader``: turns decoded data into a ``requests.Request``. ``regular_commands`` has the types of frequent
  commands; ``fields``, ``geometry`` and ``array_geometry`` read all commands, including irregular and invalid ones.
  ``newer_commands`` reads those that Director does not have; ``command_lists`` reads them one by one.
- ``number_arrays``, ``json_kernels``, ``packed_arrays``, ``msgpack_kernels``: long arrays in JSON and MessagePack.
- ``apply``: executes the request on the live tree within the limits of ``quota``. ``responses`` defines the responses.
- ``page_commands``: executes what concerns the page: its view, and subscriptions to clicks.
"""
