"""LCM logs as states of the tree over time, and as MCAP files. ``timeline.open_log`` is the entry."""
