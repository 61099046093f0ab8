"""Base class of what is closed at the end of a ``with`` block."""

from abc import ABC, abstractmethod
from typing import TypeVar

T = TypeVar("T", bound="Closing")


class Closing(ABC):
    """Context manager that returns itself, and closes itself at the end."""

    @abstractmethod
    def close(self) -> None:
        """Release what it holds."""

    def __enter__(self: T) -> T:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
