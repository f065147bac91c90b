"""Common parts of the nodes: parameters, life cycle, and the client of the driver."""

from typing import TYPE_CHECKING

from crane_model.lazily import lazily

if TYPE_CHECKING:
    from crane_nodes.driver_client import DriverClient as DriverClient
    from crane_nodes.driver_client import NoDriverError as NoDriverError
    from crane_nodes.managed import ros as ros
    from crane_nodes.managed import run_managed as run_managed
    from crane_nodes.parameters import Number as Number
    from crane_nodes.parameters import Numbers as Numbers
    from crane_nodes.parameters import Switch as Switch
    from crane_nodes.parameters import Text as Text
    from crane_nodes.parameters import declare as declare

__getattr__, __dir__, __all__ = lazily(__name__, __file__)
