"""Recordings: what was logged, and how it is read."""

from typing import TYPE_CHECKING

from crane_model.lazily import lazily

if TYPE_CHECKING:
    from crane_identification.data.bag_log import read_bag as read_bag
    from crane_identification.data.column_map import ColumnMap as ColumnMap
    from crane_identification.data.log import Log as Log
    from crane_identification.data.log import Signal as Signal
    from crane_identification.data.recording_log import read_recording as read_recording

__getattr__, __dir__, __all__ = lazily(
    __name__,
    {
        "bag_log": ("read_bag",),
        "column_map": ("ColumnMap",),
        "log": ("Log", "Signal"),
        "recording_log": ("read_recording",),
    },
)
