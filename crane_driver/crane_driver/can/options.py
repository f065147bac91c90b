"""CAN bus settings from what a command line or a ROS parameter can carry."""

from collections.abc import Sequence

import yaml
from pydantic import ValidationError

from crane_driver.can.bus import BusSettings, Extra
from crane_model.errors import ConfigurationError


def bus_settings(
    interface: str, channel: str = "", bitrate: int = 0, options: Sequence[str] = ()
) -> BusSettings:
    """Settings of a bus; an empty channel and bit rate 0 leave them to python-can.

    options: further ones of the interface as KEY=VALUE, for example port=43113.
    `ConfigurationError` names the option that is wrong.
    """
    extra: dict[str, Extra] = {}
    for option in options:
        key, equals, text = option.partition("=")
        value = yaml.safe_load(text) if equals else None
        if not (key.isidentifier() and isinstance(value, bool | int | float | str)):
            raise ConfigurationError(
                f"bus option '{option}': write KEY=VALUE, for example port=43113"
            )
        extra[key] = value
    try:
        return BusSettings(
            interface=interface, channel=channel or None, bitrate=bitrate or None, extra=extra
        )
    except ValidationError as error:
        (problem, *_) = error.errors(include_url=False)
        key = ".".join(str(part) for part in problem["loc"])
        raise ConfigurationError(
            f"bus {key}: {problem['msg']} (got {problem['input']!r})"
        ) from None
