"""The command line: ``scenegate serve | render | check | warmup``."""

from gateway.cli.main import main

__all__ = ["main"]
