"""All settings of the gateway: name, default, limits and help text, each defined once.

The flags of ``scenegate serve``, the ``SCENEGATE_*`` environment variables, the keys of the TOML file and
``docs/configuration.md`` are made from them. Flags override the environment, which overrides the file.
"""

from typing import Final

from gateway.runtime.settings.setting_sources import SettingsError, load, unknown_environment
from gateway.runtime.settings.settings import Settings

MIB: Final = 1 << 20

__all__ = ["MIB", "Settings", "SettingsError", "load", "unknown_environment"]
