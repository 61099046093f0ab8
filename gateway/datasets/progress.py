"""The samples that a run is to make, by number, and those that it has, by their place in the journal.

There may be millions: a sample takes 8 bytes here, and its line is on disk.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterator
from dataclasses import dataclass
from typing import BinaryIO, Final

from gateway.client import manifest
from gateway.client.manifest import Sample
from gateway.datasets.plan import Order
from gateway.datasets.sources import Source
from gateway.datasets.views import View

_ABSENT: Final = -1


@dataclass(frozen=True, slots=True)
class Planned:
    """A sample that was asked for."""

    number: int
    """Its place in the finished manifest, if nothing fails."""
    source: Source
    view: View


class Plan:
    """Finds planned samples by their ids."""

    def __init__(self, order: Order) -> None:
        self._order = order
        self._scenes: dict[str, tuple[int, Source]] = {}
        self._places: dict[int, dict[str, int]] = {}
        """By identity of the views, which the order keeps: most scenes have the same."""
        self.size = 0
        for source in order.sources:
            self._scenes[source.name] = self.size, source
            self.size += len(order.views_of(source))

    def find(self, sample_id: str) -> Planned | None:
        """None: nobody asked for it."""
        scene, _, name = sample_id.rpartition("/")
        if (known := self._scenes.get(scene)) is None:
            return None
        first, source = known
        views = self._order.views_of(source)
        if (places := self._places.get(id(views))) is None:
            places = self._places[id(views)] = {view.name: place for place, view in enumerate(views)}
        place = places.get(name)
        return None if place is None else Planned(first + place, source, views[place])


class Ledger:
    """A journal that is written, and where in it each sample is."""

    def __init__(self, plan: Plan, journal: BinaryIO) -> None:
        """``journal``: open for reading and writing, empty."""
        self._plan = plan
        self._journal = journal
        self._end = 0
        self._places = array("q", [_ABSENT]) * plan.size
        self.count = 0

    def has(self, number: int) -> bool:
        """Whether a sample is there."""
        return self._places[number] != _ABSENT

    def add(self, sample: Sample) -> None:
        """Notes a sample of the plan; the last word about one counts."""
        planned = self._plan.find(sample.id)
        assert planned is not None
        self.count += not self.has(planned.number)
        self._places[planned.number] = self._end
        self._end += self._journal.write(manifest.encode(sample) + b"\n")

    def flush(self) -> None:
        """Whoever kills this process now leaves a journal with all that was added."""
        self._journal.flush()

    def lines(self) -> Iterator[bytes]:
        """The lines of all samples in the order of the plan."""
        self._journal.flush()
        for place in self._places:
            if place != _ABSENT:
                if self._journal.tell() != place:
                    self._journal.seek(place)
                yield self._journal.readline()
        self._journal.seek(self._end)
