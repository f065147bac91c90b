"""Recordings: what was logged, and how it is read."""

from typing import TYPE_CHECKING

from crane_identification.lazy import importer

if TYPE_CHECKING:
    from crane_identification.data.bag_log import read_bag as read_bag
    from crane_identification.data.column_map import ColumnMap as ColumnMap
    from crane_identification.data.log import Log as Log
    from crane_identification.data.log import Signal as Signal
    from crane_identification.data.recording_log import read_recording as read_recording

_HOMES = {
    "ColumnMap": "column_map",
    "Log": "log",
    "Signal": "log",
    "read_bag": "bag_log",
    "read_recording": "recording_log",
}
__all__ = sorted(_HOMES)
__getattr__ = importer(__name__, _HOMES)
