"""What survives restarts and crashes: one SQLite file with a write-ahead log, a group of tables a room."""
