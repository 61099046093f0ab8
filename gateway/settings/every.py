"""All options together, and what holds between them."""

from __future__ import annotations

from typing import Self

from pydantic import model_validator
from pydantic_settings import BaseSettings, PydanticBaseSettingsSource, SettingsConfigDict

from gateway.settings.house import HouseSettings
from gateway.settings.interfaces import InterfaceSettings
from gateway.settings.stereo import StereoSettings
from gateway.settings.types import ENV_PREFIX


class Settings(HouseSettings, StereoSettings, InterfaceSettings):  # pydantic lists the last one's options first
    """See ``docs/configuration.md``, which is generated from this class."""

    model_config = SettingsConfigDict(
        env_prefix=ENV_PREFIX, extra="forbid", frozen=True, env_ignore_empty=True, validate_default=False
    )

    @model_validator(mode="after")
    def _certificate_and_key(self) -> Self:
        if (self.grpc_certificate is None) != (self.grpc_key is None):
            raise ValueError("--grpc-certificate and --grpc-key need each other")
        if (self.http_certificate is None) != (self.http_key is None):
            raise ValueError("--http-certificate and --http-key need each other")
        if self.grpc_client_ca is not None and self.grpc_certificate is None:
            raise ValueError("--grpc-client-ca needs --grpc-certificate and --grpc-key")
        return self

    @classmethod
    def settings_customise_sources(
        cls,
        settings_cls: type[BaseSettings],
        init_settings: PydanticBaseSettingsSource,
        env_settings: PydanticBaseSettingsSource,
        dotenv_settings: PydanticBaseSettingsSource,
        file_secret_settings: PydanticBaseSettingsSource,
    ) -> tuple[PydanticBaseSettingsSource, ...]:
        """Flags, then environment; the file is joined in ``gateway.settings.sources``, no .env file is read."""
        return init_settings, env_settings
