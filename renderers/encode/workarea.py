"""Where in the work area of ``renderers.encode.deflate`` its tables and what goes from call to call stand."""

from __future__ import annotations

from typing import Final

PADDING: Final = 64
"""Bytes after the filtered rows that may be read, and after the output that may be written."""
TABLES: Final = 17456
"""Bytes of the work area that hold tables; behind them are 16 for every repetition, of at least 16 bytes each."""

# Bytes from the start.
COUNTS: Final = 0
"""uint32: eight times 256 of literals (one would wait for itself), then, int64, the code lengths' tokens."""
TOTALS: Final = 8192
"""int64, 288: of the block's symbols."""
HEAP: Final = 10496
"""int64, 640."""
CODE_LENGTHS: Final = 15616
"""Bytes, 320: of the literals, then of the distances."""
CODES: Final = 15936
"""uint32, 288."""
META_COUNTS: Final = 17088
"""int64, 24: of the code lengths."""
META_LENGTHS: Final = 17280
"""Bytes, 32."""
META_CODES: Final = 17312
"""uint32, 24."""
STATE: Final = 17408
"""int64, 5: bits that wait, how many, where in the output they go, the checksum, and the row."""
CHECKSUM: Final[int] = STATE // 8 + 3
"""Where in the work area, in words, the Adler-32 of what was filtered so far stands."""
ROW: Final[int] = STATE // 8 + 4
"""Where the next row to be written stands."""


def room_of(size: int) -> int:
    """Bytes that a block of so many filtered ones may take, whatever they are."""
    return size * 3 // 2 + 1024 + 2 * PADDING
