"""The protocols, each in a room of its own, unknown to each other: ``gateway.wiring`` joins them.

- ``render``: Drake's glTF render server. ``stereo``: the rc_visard stereo camera, gRPC and REST.
- ``treeviewer``: Director's remote tree viewer over LCM. ``drakeviewer``: what Drake's simulators publish over LCM.
- ``viewer``: the page in the browser, and its images. ``sceneapi``: the live scene over HTTP.
- ``foxglove``: Foxglove's WebSocket.
"""
