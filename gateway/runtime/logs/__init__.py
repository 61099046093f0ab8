"""Reports of the process: log lines, metrics, spans and lists of warnings."""
