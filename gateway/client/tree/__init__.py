"""A client of Director's tree viewer, typed: geometry by path, over LCM (UDP multicast or TCPQ).

Needs lcm, numpy and msgspec, Pillow for colours given as text, and nothing of the server. ``gateway.client`` has the
names that users need.
"""
