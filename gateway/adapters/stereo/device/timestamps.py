"""Timestamps in nanoseconds since the epoch, and as text."""

NANOSECONDS_PER_SECOND = 1_000_000_000


def parse_timestamp(timestamp: str) -> int:
    """Return the nanoseconds of ``1700000000.040000000``, exactly. Raises ValueError for a malformed timestamp.

    The digits after the point are nanoseconds, padded on the right.
    """
    seconds, _, fraction = timestamp.partition(".")
    digits = seconds + fraction
    if not (digits.isascii() and digits.isdigit() and seconds and len(seconds) <= 12 and len(fraction) <= 9):
        raise ValueError(f"timestamp {timestamp[:40]!r} is not like 1700000000.040000000")
    return int(seconds) * NANOSECONDS_PER_SECOND + int(fraction.ljust(9, "0"))


def timestamp_text(nanoseconds: int) -> str:
    """Return a timestamp as text; the inverse of ``parse_timestamp``."""
    return f"{nanoseconds // NANOSECONDS_PER_SECOND}.{nanoseconds % NANOSECONDS_PER_SECOND:09d}"
