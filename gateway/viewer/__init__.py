"""The browser view of the live tree: wire format, sessions with credit, routes, the built page.

Knows the scene only; what it shows of other interfaces reaches it as values through ports that the application wires.
"""
