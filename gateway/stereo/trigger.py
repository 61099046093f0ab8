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
            return -8, "Triggering is only possible in SingleFrame acquisition mode"
        if not wanted:
            return 102, "Trigger is ignored, because there are no subscribers"
        if self.pending:
            return 101, "Trigger is ignored, because there is a trigger call pending"
        self.pending = True
        return 0, ""

    def taken(self) -> None:
        """The image was taken."""
        self.pending = False
