"""The HTTP edge, shared by all interfaces.

From the connection inwards: ``http_server`` (servers and ports), ``http_protocol``, ``websocket_protocol`` and
``sliced_reads`` (limits per connection), ``middleware`` (ids, logs, metrics), ``security`` with ``access``, ``tokens`` and
``grpc_tokens`` (who may use what), ``error_handlers``, ``disconnect``. Routes: ``health`` and ``index_page``; ``openapi``
describes what all routes share, and ``healthcheck`` is the container's.
"""
