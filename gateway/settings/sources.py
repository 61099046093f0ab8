"""Where settings come from: flags, environment, a TOML file; and a sentence for each that cannot be used."""

from __future__ import annotations

import os
import tomllib
from collections.abc import Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from gateway.settings.every import Settings
from gateway.settings.types import CONFIG_ENV, ENV_PREFIX, OTHER_ENV, env_of, flag_of


class SettingsError(ValueError):
    """Settings cannot be used; the message has one sentence a line."""


def load(flags: Mapping[str, Any] | None = None, config: Path | None = None) -> Settings:
    """Settings from flags, environment and TOML file, in this order of precedence.

    Args:
        flags: what the command line gave, by setting; absent is not given.
        config: the TOML file; None: the one that SCENEGATE_CONFIG names, if any.

    Raises:
        SettingsError: with a sentence for each value that cannot be used and where it came from.
    """
    flags = dict(flags or {})
    if config is None and os.environ.get(CONFIG_ENV):
        config = Path(os.environ[CONFIG_ENV])
    from_file = _read_file(config) if config is not None else {}
    in_force = {name: value for name, value in from_file.items() if not os.environ.get(env_of(name))}
    try:
        return Settings(**{**in_force, **flags})
    except ValidationError as error:
        sentences = []
        for fault in error.errors(include_url=False):
            reason = fault["msg"].removeprefix("Value error, ")
            if not fault["loc"]:
                sentences.append(f"{reason}.")
                continue
            name = str(fault["loc"][0])
            if name in flags:
                origin = flag_of(name)
            elif os.environ.get(env_of(name)):
                origin = env_of(name)
            else:
                origin = f"{name} in {config}"
            sentences.append(f"{origin}: {reason[:1].lower()}{reason[1:]}, got {fault['input']!r}.")
        raise SettingsError("\n".join(sentences)) from None


def unknown_environment() -> list[str]:
    """A sentence for each SCENEGATE_* variable that is no setting: a typing error would pass unseen otherwise."""
    known = {env_of(name) for name in Settings.model_fields} | OTHER_ENV
    return [
        f"{name} is no setting{_suggestion(name, known)}"
        for name in sorted(os.environ)
        if name.startswith(ENV_PREFIX) and name not in known
    ]


def _read_file(path: Path) -> dict[str, Any]:
    try:
        values = tomllib.loads(path.read_text("utf-8"))
    except OSError as error:
        raise SettingsError(f"The configuration file {path} cannot be read: {error.strerror}.") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise SettingsError(f"The configuration file {path} is not TOML: {error}.") from None
    values = {name.replace("-", "_"): value for name, value in values.items()}
    unknown = [name for name in values if name not in Settings.model_fields]
    if unknown:
        raise SettingsError(
            "\n".join(f"{name} in {path} is no setting{_suggestion(name, Settings.model_fields)}" for name in unknown)
        )
    return values


def _suggestion(name: str, known: Any) -> str:
    close = get_close_matches(name, list(known), n=1)
    return f"; did you mean {close[0]}?" if close else "."
