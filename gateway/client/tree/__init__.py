"""Typed client of Director's tree viewer: geometry by path, over LCM (UDP multicast or TCPQ).

``viewer`` is the client and ``aio`` its asyncio version; ``geometry`` and ``colors`` define what can be published,
``published`` records it; ``wire`` encodes the messages and ``connection`` sends them. Needs lcm, numpy and msgspec,
Pillow for colours given as text, and nothing of the server. ``gateway.client`` exports the public names.
"""
