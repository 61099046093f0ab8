"""Connects the interfaces to the process: one module per interface, each with ``setup(context)``.

``setup`` reads top to bottom: settings become the interface's config, the config its service, and the service gets
its routes or is run. ``context`` has the objects that all interfaces share, ``startup`` starts them, ``metrics`` lists
their metrics.
"""
