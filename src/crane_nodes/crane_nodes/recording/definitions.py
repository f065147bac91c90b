"""Message definitions as bags carry them, of every interface package that is installed."""

from dataclasses import dataclass
from functools import cache
from importlib import import_module
from typing import Any

from rosbags.interfaces import Nodetype
from rosbags.typesys import get_types_from_msg
from rosbags.typesys.store import Typestore

from crane_bags.types import typestore
from crane_model.errors import DataError


@dataclass(frozen=True)
class Definition:
    """What a bag keeps of a message type, so that it can be read where the type is unknown."""

    encoding: str  # "ros2msg" or "ros2idl"
    text: str  # with the text of every type in it
    type_hash: str  # RIHS01_...; empty where unknown


@cache
def installed_definition(msgtype: str) -> Definition:
    """The definition of `pkg/msg/Type` as installed on this machine.

    `DataError` if there is none: the package is not installed, or the type is no message.
    """
    store = typestore()
    _complete(store, msgtype)
    text, _ = store.generate_msgdef(msgtype, ros_version=2)
    return Definition("ros2msg", text, store.hash_rihs01(msgtype))


def message_class(msgtype: str) -> Any:
    """The Python class of `pkg/msg/Type`; `DataError` if it is not installed."""
    package, _, name = msgtype.partition("/msg/")
    try:
        return getattr(import_module(f"{package}.msg"), name)
    except (ImportError, AttributeError):
        raise _absent(msgtype) from None


@cache
def hash_of(msgtype: str, encoding: str, text: str) -> str:
    """Type hash of a definition that came without one; empty where its text does not give it."""
    if encoding != "ros2msg":
        return ""
    try:
        store = Typestore()
        store.register(get_types_from_msg(text, msgtype))
        return store.hash_rihs01(msgtype)
    except Exception:  # the text is whatever stands in somebody's bag
        return ""


def _complete(store: Typestore, msgtype: str) -> None:
    """Add a type, and the types it is made of, from the .msg files of the ament index."""
    if msgtype in store.fielddefs:
        return
    types = get_types_from_msg(_text(msgtype), msgtype)
    for _, description in types[msgtype][1]:
        for name in _names(description):
            _complete(store, name)
    store.register(types)


def _names(description: Any) -> list[str]:
    """Message types in the description of a field: itself, or what it is an array of."""
    kind, inner = description
    if kind == Nodetype.NAME:
        return [inner]
    return [] if kind == Nodetype.BASE else _names(inner[0])


def _text(msgtype: str) -> str:
    package, _, name = msgtype.partition("/msg/")
    try:
        from ament_index_python.packages import get_package_share_path  # absent without ROS

        share = get_package_share_path(package, print_warning=False)
        return (share / "msg" / f"{name}.msg").read_text("utf-8")
    except (ImportError, LookupError, ValueError, OSError):
        raise _absent(msgtype) from None


def _absent(msgtype: str) -> DataError:
    return DataError(
        f"message type {msgtype} is not installed; build its package and source its environment "
        "file"
    )
