"""What the nodes of the suite share."""

from typing import TYPE_CHECKING

from crane_model.lazily import lazily

if TYPE_CHECKING:
    from crane_nodes.context import Stop as Stop
    from crane_nodes.context import ros as ros
    from crane_nodes.driver_client import DriverClient as DriverClient
    from crane_nodes.driver_client import NoDriverError as NoDriverError
    from crane_nodes.managed import run_managed as run_managed
    from crane_nodes.parameters import Number as Number
    from crane_nodes.parameters import Numbers as Numbers
    from crane_nodes.parameters import Switch as Switch
    from crane_nodes.parameters import Text as Text
    from crane_nodes.parameters import declare as declare
    from crane_nodes.parameters import hold as hold
    from crane_nodes.polled import Polled as Polled
    from crane_nodes.ready import say_ready as say_ready

__getattr__, __dir__, __all__ = lazily(
    __name__,
    {
        "context": ("Stop", "ros"),
        "driver_client": ("DriverClient", "NoDriverError"),
        "managed": ("run_managed",),
        "parameters": ("Number", "Numbers", "Switch", "Text", "declare", "hold"),
        "polled": ("Polled",),
        "ready": ("say_ready",),
    },
)
