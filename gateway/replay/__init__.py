"""States of the scene over time, and what is made of them: each is a ``gateway.scene.tree.timeline.Timeline``.

- ``history``: the recent states of the live tree, with ``packed_changes``.
- ``log_timeline``: an LCM log, with ``log_replay``. ``log_service`` shows it in place of the live
  tree, ``log_to_mcap`` writes it as MCAP.
- ``page_recorder``: a section of a timeline for the page, ``page_file`` in one HTML file, ``share_routes`` over HTTP.
"""
