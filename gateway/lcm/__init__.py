"""LCM transports for the event loop. Nothing here depends on what the messages mean.

- ``transport``: the interface that all transports share; ``network``: opens the right one for a URL.
- ``udpm``, ``udpm_assembler``: UDP multicast on the wire; ``udpm_socket``, ``udpm_sender``, ``udpm_transport``: I/O.
- ``tcpq``: TCPQ on the wire; ``tcpq_transport``: a client of another hub; ``tcpq_hub``: a hub of our own.
- ``patterns``, ``subscriptions``: regular expressions of hub clients, with a limit on their matching time.
- ``liblcm_transport``: LCM's own library, for ``memq://``, ``mpudpm://`` and ``file://``.
- ``event_log``, ``replay``: LCM's log files, recorded from a network and played into one.
"""
