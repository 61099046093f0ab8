"""Depth images on demand: the service acquisition_trigger of the single-frame modes."""

from __future__ import annotations


class Trigger:
    """Whether a depth image was asked for and is still to be taken."""

    def __init__(self) -> None:
        self.pending = False

    def fire(self, *, single: bool, wanted: bool) -> tuple[int, str]:
        """Asks for one depth image.

        Args:
            single: whether the acquisition mode is a single-frame one.
            wanted: whether any client streams depth.

        Returns:
            The device's return code and a message.
        """
        if not single:
            return -8, "acquisition_mode is not SingleFrame or SingleFrameOut1"
        if not wanted:
            return 102, "nobody has subscribed to depth images; triggered anyway"
        if self.pending:
            return 101, "the previous trigger is still pending"
        self.pending = True
        return 0, ""

    def taken(self) -> None:
        """The image was taken."""
        self.pending = False
