"""Clients that users install: they know the wire, not the server."""
