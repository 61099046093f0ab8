"""The command line: ``scenegate serve | render | stream | dataset | check | warmup``."""

from gateway.cli.main import main

__all__ = ["main"]
