"""All settings in one class, and the rules between them."""

import os
from pathlib import Path
from typing import Final, Self

from pydantic import model_validator
from pydantic_settings import SettingsConfigDict

from gateway.runtime.settings.interfaces import InterfaceSettings
from gateway.runtime.settings.option import ENV_PREFIX
from gateway.runtime.settings.process import ProcessSettings
from gateway.runtime.settings.stereo import StereoSettings
from gateway.runtime.workers.scheduling import usable_cpus
from scenegate.lcm.url import check_lcm_url

_AUTO: Final = Path("auto")
_OFF: Final = Path("off")
"""Words of ``--mesh-root``, which are not folders."""


class Settings(ProcessSettings, StereoSettings, InterfaceSettings):  # pydantic lists the last base's fields first
    """See ``docs/configuration.md``, which is generated from this class."""

    model_config = SettingsConfigDict(env_prefix=ENV_PREFIX, extra="forbid", frozen=True, env_ignore_empty=True)

    @model_validator(mode="after")
    def _check_certificates(self) -> Self:
        if (self.grpc_certificate is None) != (self.grpc_key is None):
            raise ValueError("--grpc-certificate and --grpc-key need each other")
        if (self.http_certificate is None) != (self.http_key is None):
            raise ValueError("--http-certificate and --http-key need each other")
        if self.grpc_client_ca is not None and self.grpc_certificate is None:
            raise ValueError("--grpc-client-ca needs --grpc-certificate and --grpc-key")
        return self

    @model_validator(mode="after")
    def _check_lcm_default_url(self) -> Self:
        """Refuse an invalid LCM_DEFAULT_URL, the LCM network without --lcm-url, here and not when LCM starts."""
        url = os.environ.get("LCM_DEFAULT_URL")
        if url and self.lcm_url is None and self.is_enabled("treeviewer"):
            try:
                check_lcm_url(url)
            except ValueError as error:
                raise ValueError(f"LCM_DEFAULT_URL: {error}, got {url!r}") from None
        return self

    @model_validator(mode="after")
    def _check_mesh_root(self) -> Self:
        if _OFF in self.mesh_root and len(self.mesh_root) > 1:
            raise ValueError("--mesh-root off excludes folders and auto")
        return self

    @model_validator(mode="after")
    def _check_workers(self) -> Self:
        if self.workers == 1:
            return self
        workers = self.workers or "auto"  # ProcessCount reads auto as 0
        if self.only != ("render",):
            raise ValueError(
                f"--workers {workers} needs --only render: the live scene, the stereo camera, LCM and the "
                "browser view belong to one process"
            )
        conflicts = {
            "--state": (self.state is not None, "one process writes that file"),
            "--demo": (self.demo, "the live scene belongs to one process"),
            "--foxglove-port": (self.foxglove_port is not None, "one process listens there"),
            "--backdrop live": (self.backdrop == "live", "the live scene belongs to one process"),
        }
        for setting, (given, reason) in conflicts.items():
            if given:
                raise ValueError(f"--workers {workers} and {setting} exclude each other: {reason}")
        return self

    @property
    def processes(self) -> int:
        """Number of processes that serve the HTTP port, at least 1."""
        return self.workers or max(1, usable_cpus() // 2)

    @property
    def mesh_folders(self) -> tuple[Path, ...]:
        """Folders of ``mesh_root``, without ``auto`` and ``off``."""
        return tuple(path for path in self.mesh_root if path not in (_AUTO, _OFF))

    @property
    def local_clients_read_all_folders(self) -> bool:
        """True for ``auto``, except behind a proxy, where clients that seem to be on this machine may not be."""
        return _AUTO in self.mesh_root and not self.root_path
