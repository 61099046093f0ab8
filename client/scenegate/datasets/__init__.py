"""Reads datasets that ``scenegate render`` has written. ``manifest`` has the records of their files."""

from scenegate.datasets.dataset import NO_LABEL as NO_LABEL
from scenegate.datasets.dataset import Dataset as Dataset
from scenegate.datasets.dataset import Sample as Sample
from scenegate.datasets.manifest import RecordError as RecordError
