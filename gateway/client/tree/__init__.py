"""Typed client of Director's tree viewer: publish geometry at paths over LCM (UDP multicast or TCPQ).

- ``viewer``: the client; ``aio``: the same for asyncio.
- ``nodes``: paths and batches; ``answer``: results of requests.
- ``geometry``, ``image_geometry``, ``colors``: geometry that can be published.
- ``clicks``: clicks in the browser.
- ``published``: changes of a request, and a record of published geometry.
- ``robot``: robots that joint values move; ``parts``: scene geometry as geometry of the protocol.
- ``wire``: encoding of requests and responses; ``connection``: LCM.

The package needs lcm, numpy and msgspec, and Pillow for colours given as text and for images sent as JSON. It imports
no module of the server, except to read robot files.
``gateway.client`` exports the public names.
"""
