"""The hub of TCPQ, and what receives LCM's messages in the server. ``scenegate.lcm`` has the transports.

- ``tcpq_hub``: the hub; ``subscriptions``: regular expressions of its clients, with a limit on the time of matching.
- ``listener``: a part of the server that receives some channels.
"""
