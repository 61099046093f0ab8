"""LCM logs as states of the tree over time. ``timeline.open_log`` is the entry."""
