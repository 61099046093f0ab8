"""``python -m scenegate``."""

from __future__ import annotations

from scenegate.cli import main

main()
