"""The HTTP edge, shared by all interfaces.

From the connection inwards:

- ``http_server``: servers and ports.
- ``http_protocol``, ``websocket_protocol``: limits per connection; with ``sliced_reads`` and ``joined_head``.
- ``edge``: request ids, log lines, metrics, HEAD, early responses. ``path_prefix``.
- ``security``, with ``protection``, ``access``, ``tokens`` and ``grpc_tokens``: access control.
- ``body_receiver``: bodies. ``scene_query``: parameters that routes of several interfaces share.
- ``error_handlers``, ``plain_error_route``, ``disconnect``: responses to errors, and clients that disconnect.
- ``health``, ``pages``: routes. ``start_gate``: requests during the start.
- ``interface_names``: names for people.
- ``openapi``: the part of the description that all routes share.
- ``healthcheck``: the container's health check, a program.
"""
