"""Stores failed requests on disk, for replay.

Each request has two files: the body as received, and a JSON file with the error and the Content-Type that is needed to
send the request again (``curl --data-binary @NAME.multipart -H 'Content-Type: …' URL``).
"""

import json
import re
import threading
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

_BODY_SUFFIX: Final = ".multipart"
_FILE_NAME: Final = re.compile(r"\d{8}T\d{12}Z-\d{3}-[0-9a-zA-Z]{1,32}\.(multipart|json)")
"""Names of the files that may be deleted. Other files in the folder are left alone."""
_UNSAFE_CHARACTER: Final = re.compile(r"[^0-9a-zA-Z]")


class FailureStore:
    """Folder with limits on count and size; the oldest requests are deleted first. Thread-safe, blocking."""

    def __init__(self, folder: Path, max_count: int, max_bytes: int) -> None:
        self._folder = folder
        self._max_count = max_count
        self._max_bytes = max_bytes
        self._lock = threading.Lock()

    def store(
        self, body: Sequence[bytes | memoryview], content_type: str, status: int, reason: str, request_id: str
    ) -> Path | None:
        """Store a request.

        Args:
            body: the received pieces of the body.
            content_type: Content-Type header of the request.
            reason: error message of the response.

        Returns:
            Path of the body's file; None if the body is larger than the folder's limit.

        Raises:
            OSError: the folder is not writable.
        """
        size = sum(map(len, body))
        if size > self._max_bytes or self._max_count < 1:
            return None
        now = datetime.now(UTC)
        stem = f"{now:%Y%m%dT%H%M%S%f}Z-{status:03d}-{_UNSAFE_CHARACTER.sub('', request_id)[:32] or '0'}"
        description = {"time": now.isoformat(), "status": status, "reason": reason, "content_type": content_type}
        description |= {"request_id": request_id, "bytes": size}
        with self._lock:
            self._folder.mkdir(parents=True, exist_ok=True)
            path = self._folder / (stem + _BODY_SUFFIX)
            with path.open("wb") as file:
                file.writelines(body)
            path.with_suffix(".json").write_text(json.dumps(description, indent=1) + "\n", encoding="utf-8")
            self._prune()
        return path

    def _prune(self) -> None:
        files = sorted(p for p in self._folder.iterdir() if _FILE_NAME.fullmatch(p.name) and p.is_file())
        sizes = {p: p.stat().st_size for p in files}
        bodies = [p for p in files if p.suffix == _BODY_SUFFIX]
        total = sum(sizes[p] for p in bodies)
        while bodies and (len(bodies) > self._max_count or total > self._max_bytes):
            oldest = bodies.pop(0)
            total -= sizes[oldest]
            oldest.unlink(missing_ok=True)
            oldest.with_suffix(".json").unlink(missing_ok=True)
