"""Loads settings from flags, environment and a TOML file; every invalid value is one sentence that names its source."""

import os
import tomllib
from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Any, Final

from pydantic import ValidationError

from gateway.runtime.settings.option import ENV_PREFIX, env_of, flag_of
from gateway.runtime.settings.settings import Settings
from scenegate.regular_files import read_file_or_pipe

CONFIG_ENV: Final = "SCENEGATE_CONFIG"
NON_SETTING_VARIABLES: Final = frozenset(
    {
        CONFIG_ENV,
        "SCENEGATE_ASSET_GENERATOR",
        "SCENEGATE_CA",
        "SCENEGATE_CACHE_DIR",
        "SCENEGATE_CHECK_KERNELS",
        "SCENEGATE_CORPUS",
        "SCENEGATE_DIRECTOR",
        "SCENEGATE_DRAKE_PYTHON",
        "SCENEGATE_FIDELITY",
        "SCENEGATE_NEW_DRAKE_PYTHON",
        "SCENEGATE_RAY_PYTHON",
        "SCENEGATE_REGENERATE_PICTURES",
        "SCENEGATE_ROBOTS",
        "SCENEGATE_SCHEMATHESIS",
        "SCENEGATE_TOKEN",
        "SCENEGATE_URL",
    }
)
"""Our environment variables that are not settings."""
MAX_FILE_BYTES: Final = 1 << 20
"""Maximum size of a configuration file."""


class SettingsError(ValueError):
    """Invalid settings; the message has one sentence per line."""


def load(flags: Mapping[str, Any] | None = None, config: Path | None = None) -> Settings:
    """Return the settings; flags override the environment, which overrides the TOML file.

    ``config``: default: the file named by SCENEGATE_CONFIG, if set. Raises SettingsError.
    """
    flags = flags or {}
    if config is None and os.environ.get(CONFIG_ENV):
        config = Path(os.environ[CONFIG_ENV])
    from_file = _read_file(config) if config is not None else {}
    # Settings reads the environment itself, but arguments override it: the file must not.
    from_file = {name: value for name, value in from_file.items() if not os.environ.get(env_of(name))}
    try:
        return Settings(**{**from_file, **flags})
    except ValidationError as error:
        sentences = (_sentence(fault, flags, config) for fault in error.errors(include_url=False))
        raise SettingsError(" ".join(sentences)) from None


def unknown_environment() -> list[str]:
    """Return a sentence for each SCENEGATE_* variable that is not a setting, such as a misspelt one."""
    known = {env_of(name) for name in Settings.model_fields} | NON_SETTING_VARIABLES
    return [
        f"{name} is not a setting{_suggestion(name, known)}"
        for name in sorted(os.environ)
        if name.startswith(ENV_PREFIX) and name not in known
    ]


def _sentence(fault: Mapping[str, Any], flags: Mapping[str, Any], config: Path | None) -> str:
    """Return a pydantic error as one sentence."""
    reason = fault["msg"].removeprefix("Value error, ")
    if not fault["loc"]:  # a rule between settings, which names them itself
        return f"{reason}."
    name = str(fault["loc"][0])
    if name in flags:
        source = flag_of(name)
    elif os.environ.get(env_of(name)):
        source = env_of(name)
    else:
        source = f"{name} in {config}"
    return f"{source}: {reason[:1].lower()}{reason[1:]}, got {fault['input']!r}."


def _read_file(path: Path) -> dict[str, Any]:
    try:
        values = tomllib.loads(read_file_or_pipe(path, MAX_FILE_BYTES).decode())
    except OSError as error:
        raise SettingsError(f"The configuration file {path} cannot be read: {error.strerror}.") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise SettingsError(f"The configuration file {path} is not TOML: {error}.") from None
    values = {name.replace("-", "_"): value for name, value in values.items()}
    known = Settings.model_fields
    if unknown := [
        f"{name} in {path} is not a setting{_suggestion(name, known)}" for name in values if name not in known
    ]:
        raise SettingsError(" ".join(unknown))
    return values


def _suggestion(name: str, known: Iterable[str]) -> str:
    """Return the end of a sentence: a known name like this one, if there is any, and the punctuation."""
    close = get_close_matches(name, list(known), n=1)
    return f"; did you mean {close[0]}?" if close else "."
