"""Foxglove's WebSocket: the live scene and the stereo camera for the Foxglove app (``--foxglove-port``).

- ``front``: the port of the clients, which refuses pages of other sites.
- ``channels``: the server, its channels and who subscribes to them.
- ``service``: sends what is subscribed.
"""
