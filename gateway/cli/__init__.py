"""The command line: ``scenegate serve | render | stream | publish | record | play | dataset | check | warmup``."""

from gateway.cli.main import main

__all__ = ["main"]
