"""For users' own integration tests: a pytest plugin with a gateway to talk to. See ``docs/testing.md``."""
