"""LCM transports on the event loop: they send and receive (channel, bytes), and do not decode messages.

- ``transport``: the interface of all transports, and the queue of what they receive.
- ``network``: opens the transport for a URL; ``url``: parses it.
- ``udpm``, ``udpm_assembler``: datagrams of UDP multicast; ``udpm_socket``, ``udpm_sender``, ``udpm_transport``: I/O.
- ``tcpq``: frames of TCPQ, LCM over TCP; ``tcpq_transport``: a client of a hub.
- ``liblcm_transport``: LCM's own library, for ``memq://``, ``mpudpm://`` and ``file://``.
- ``event_log``, ``replay``: record a network to LCM's log files, and play these into a network.
"""

import logging

logging.getLogger("scenegate.lcm").addHandler(logging.NullHandler())  # programs decide whether warnings are printed
