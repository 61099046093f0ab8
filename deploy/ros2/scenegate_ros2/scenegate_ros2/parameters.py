"""Parameters of the node; docs/ros2.md explains them."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class NodeParameters:
    """Parameters and their defaults, which config/scenegate.yaml repeats."""

    camera: str = "127.0.0.1:50051"
    url: str = "http://127.0.0.1:8000"
    token: str = ""
    pipeline: int = 0
    color: bool = False
    scene: bool = True
    reliability: str = "reliable"
    tf_rate: float = 10.0
    publish_clock: bool = False

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            ValueError: one is out of range.
        """
        if self.reliability not in ("reliable", "best_effort"):
            raise ValueError(f"reliability is {self.reliability!r}; it must be reliable or best_effort")
        if not 0.0 < self.tf_rate <= 1000.0:
            raise ValueError(f"tf_rate is {self.tf_rate} Hz; it must be above 0 and at most 1000")
