"""Certificates for 127.0.0.1, made by openssl."""

import shutil
import subprocess
from pathlib import Path

import pytest


def certificate(folder: Path, name: str = "gateway") -> tuple[Path, Path]:
    """Self-signed: the certificate and its key, PEM; skips the test where there is no openssl."""
    if shutil.which("openssl") is None:
        pytest.skip("openssl makes the certificates")
    key, pem = folder / f"{name}.key", folder / f"{name}.pem"
    command = ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-keyout", str(key)]
    command += ["-out", str(pem), "-subj", f"/CN={name}", "-addext", "subjectAltName=IP:127.0.0.1"]
    subprocess.run(command, check=True, capture_output=True)
    return pem, key
