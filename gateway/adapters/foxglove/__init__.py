"""Foxglove's WebSocket: the live scene and the stereo camera for the Foxglove app (``--foxglove-port``).

- ``channels``: the server, its channels and who subscribes to them.
- ``service``: sends what is subscribed.
"""
