"""Write datasets in the formats that other programs read: BOP, COCO, WebDataset, HDF5. See ``docs/dataset-formats.md``.

COCO, WebDataset and HDF5 need the packages of ``scenegate-client[formats]``.
"""

from __future__ import annotations

from scenegate.datasets.formats.exporting import FORMATS as FORMATS
from scenegate.datasets.formats.exporting import ExportError as ExportError
from scenegate.datasets.formats.exporting import FormatName as FormatName
from scenegate.datasets.formats.exporting import check_destination as check_destination
from scenegate.datasets.formats.exporting import check_types as check_types
from scenegate.datasets.formats.exporting import export as export
