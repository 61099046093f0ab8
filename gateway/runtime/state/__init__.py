"""The persistent state: the live tree and the stereo cameras' parameters in one SQLite file; see ``service``."""
