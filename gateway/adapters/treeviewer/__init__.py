"""Director's remote tree viewer: LCM requests edit the live tree, and each request gets a response.

``service`` starts the transports and the hub (``gateway.runtime.lcm``). A request from them passes through the files in
this order:

- ``dispatch``: refuses a request, or passes it on. It reads and applies small requests on the event loop, others
  with a worker thread. Queues keep the order of each client's requests.
- ``protocol``: the protocol without I/O. ``wire`` decodes the message.
- ``request_reader``: turns the data in the message, JSON or MessagePack, into a ``requests.Request``. The table in
  ``commands`` says how each command is read, and has types of frequent ones, which msgspec reads;
  ``fields``, ``geometry_reader`` and the files that it names read the values in commands.
- ``number_arrays``, ``json_kernels``, ``msgpack_kernels``: long arrays in JSON and MessagePack.
- ``apply``: executes the request on the live tree within the limits of ``quota``, and on the page.
- ``delivery``: sends the response (``responses``), and delays those that Director's client would lose.
"""
