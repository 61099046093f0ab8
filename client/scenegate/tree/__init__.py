"""Typed client of Director's tree viewer: publish geometry at paths over LCM (UDP multicast or TCPQ).

- ``viewer``: the client; ``aio``: the same for asyncio.
- ``node_handles``: paths and batches; ``answer``: results of requests.
- ``published_robot``: robots that joint values move.
- ``controls``: controls in the page; ``control_panel``: their values.
- ``callbacks``: callbacks for clicks in the browser, and the threads of all callbacks.
- ``joint_sliders``: sliders that move a robot.
- ``connection``: the connection to an LCM network.
"""
