"""Operations: logs, request ids, metrics, health and readiness, the cache of compiled kernels.

Knows no interface and no settings; ``gateway.app`` hands in what is needed.
"""
