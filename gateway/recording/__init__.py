"""Recordings in other formats: LCM logs as MCAP files."""
