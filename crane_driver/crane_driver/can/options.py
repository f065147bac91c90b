"""CAN bus settings from what a command line or a ROS parameter can carry."""

from collections.abc import Sequence

from crane_driver.can.bus import BusSettings, Extra
from crane_model.configuration import validate
from crane_model.errors import ConfigurationError
from crane_model.yaml_text import WrongYamlError, YamlText


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
        if not (key.isidentifier() and equals and isinstance(value := _value(text), Extra)):
            raise ConfigurationError(
                f"bus option '{option}': write KEY=VALUE, for example port=43113"
            )
        extra[key] = value
    given = {"interface": interface, "channel": channel or None, "bitrate": bitrate or None}
    return validate({**given, "extra": extra}, BusSettings, "bus")


def _value(text: str) -> object:
    try:
        return YamlText(text).content
    except WrongYamlError:
        return None
