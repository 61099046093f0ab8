"""Depth images on demand: the service acquisition_trigger of the single-frame modes."""

from __future__ import annotations


class Trigger:
    """One pending depth image at most."""

    def __init__(self) -> None:
        self.pending = False
        """True from the service call until the depth image is captured."""

    def fire(self, *, single: bool, subscribed: bool) -> tuple[int, str]:
        """Request one depth image.

        Args:
            single: True in a single-frame acquisition mode.
            subscribed: True if a client streams depth.

        Returns:
            The device's return code and a message.
        """
        if not single:
            return -8, "Triggering is only possible in SingleFrame acquisition mode"
        if not subscribed:
            return 102, "Trigger is ignored, because there are no subscribers"
        if self.pending:
            return 101, "Trigger is ignored, because there is a trigger call pending"
        self.pending = True
        return 0, ""

    def done(self) -> None:
        """Clear the request: the depth image is captured."""
        self.pending = False
