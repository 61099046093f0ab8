"""Director's remote tree viewer: LCM requests edit the live tree, and each request gets a response.

``service`` starts the transports and the hub (``gateway.lcm``). A request from them passes through the files in this
order:

- ``dispatch``: handles small regular requests at once and others in a worker thread. ``client_queue`` keeps each
  client's requests in order, ``delayed_responses`` holds back responses that Director's client would lose.
- ``protocol``: the protocol without I/O. ``wire`` decodes the message.
- ``request_reader``: turns the data in the message into a ``requests.Request``. ``json_reader`` and ``msgpack_reader``
  prepare big requests and decode irregular ones. ``regular_commands`` has the types of frequent commands; ``fields``,
  ``geometry`` and ``array_geometry`` read all commands, including irregular and invalid ones.
  ``newer_commands`` reads those that Director does not have; ``command_lists`` reads them one by one.
- ``number_arrays``, ``json_kernels``, ``packed_arrays``, ``msgpack_kernels``: long arrays in JSON and MessagePack.
- ``apply``: executes the request on the live tree within the limits of ``quota``. ``responses`` defines the responses.
- ``page_commands``: executes what concerns the page: its view, and subscriptions to clicks.
"""
