"""Pages of docs/ that are written from the source: ``python -m tools.docs_pages docs`` writes them all.

- ``settings_page``: settings and their flags; ``limits_page``: limits with their reasons.
- ``commands_page``: the command line; ``http_page``, ``openapi_text``: the HTTP interface.
- ``grpc_page``: messages of the gRPC stream; ``lcm_page``: LCM types.
"""
