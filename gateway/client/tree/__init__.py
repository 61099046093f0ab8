"""A client of Director's tree viewer, typed: geometry by path, over LCM (UDP multicast or TCPQ).

Needs lcm, numpy and msgspec, and nothing of the server. ``gateway.client`` has the names that users need.
"""
