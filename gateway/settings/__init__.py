"""Every option of the gateway, once: its name, default, limits and what it means.

From here come the flags of ``scenegate serve``, the ``SCENEGATE_*`` environment variables, the keys of the TOML file
and ``docs/configuration.md``. A flag wins over the environment, the environment over the file, the file over the
default.
"""

from __future__ import annotations

from typing import Final

from gateway.settings.every import Settings
from gateway.settings.sources import SettingsError, load, unknown_environment

MIB: Final = 1 << 20

__all__ = ["MIB", "Settings", "SettingsError", "load", "unknown_environment"]
