"""What the nodes of the suite share.

A parameter is declared with its unit and range, and says what is wrong with a value:

>>> from crane_nodes import Number, Switch, Text
>>> speed = Number("speed", 0.3, "m/s", 0.0, 1.0, "of the tip")
>>> speed.check(1)
1.0
>>> speed.check(2.0)
Traceback (most recent call last):
...
crane_model.errors.ConfigurationError: parameter 'speed': must be from 0 to 1 m/s, got 2.0
>>> Switch("loud", False, "whether it is heard").check(True), Text("name", "", "of it").check("a")
(True, 'a')
"""

from typing import TYPE_CHECKING

from crane_model.lazily import lazily

if TYPE_CHECKING:
    from crane_nodes.driver_client import DriverClient as DriverClient
    from crane_nodes.driver_client import NoDriverError as NoDriverError
    from crane_nodes.managed import Stop as Stop
    from crane_nodes.managed import ros as ros
    from crane_nodes.managed import run_managed as run_managed
    from crane_nodes.managed import say_ready as say_ready
    from crane_nodes.parameters import Number as Number
    from crane_nodes.parameters import Numbers as Numbers
    from crane_nodes.parameters import Switch as Switch
    from crane_nodes.parameters import Text as Text
    from crane_nodes.parameters import declare as declare
    from crane_nodes.parameters import hold as hold
    from crane_nodes.polled import Polled as Polled

__getattr__, __dir__, __all__ = lazily(
    __name__,
    {
        "driver_client": ("DriverClient", "NoDriverError"),
        "managed": ("Stop", "ros", "run_managed", "say_ready"),
        "parameters": ("Number", "Numbers", "Switch", "Text", "declare", "hold"),
        "polled": ("Polled",),
    },
)
