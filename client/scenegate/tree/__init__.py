"""Typed client of Director's tree viewer: publish geometry at paths over LCM (UDP multicast or TCPQ).

- ``viewer``: the client; ``aio``: the same for asyncio.
- ``node_handles``: paths, batches, and robots that joint values move; ``answer``: results of requests.
- ``controls``: controls in the page; ``control_panel``: their values, and sliders that move a robot.
- ``callbacks``: callbacks for clicks in the browser, and the threads of all callbacks.
- ``connection``: the connection to an LCM network.
"""
