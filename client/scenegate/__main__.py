"""``python -m scenegate``."""

from scenegate.cli import main

main()
