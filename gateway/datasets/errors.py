"""The error of commands for datasets."""


class DatasetError(ValueError):
    """A dataset cannot be made of what a command names; the message is one sentence."""
