"""The section `canopen` of a mapping file: devices to be started and watched."""

from collections.abc import Mapping
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from crane_model.configuration import Schema

NMT, EMERGENCY, SDO_RESPONSE, SDO_REQUEST, HEARTBEAT = 0x000, 0x080, 0x580, 0x600, 0x700
"""Identifiers of CiA 301; all but that of NMT are counted up by the id of the node."""


class Device(Schema):
    """A CANopen device; times in s."""

    id: Annotated[int, Field(ge=1, le=127)]
    heartbeat_timeout: Annotated[float, Field(gt=0)]
    # written to object 1017h before the device is started; without it the device is left as it is
    heartbeat_period: Annotated[float, Field(ge=0.001, le=65.535)] | None = None
    emergency: Literal["report", "fault"] = "report"

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.heartbeat_period and self.heartbeat_period >= self.heartbeat_timeout:
            raise ValueError(
                f"heartbeat_period is {self.heartbeat_period:g} s, it must be less than "
                f"heartbeat_timeout, {self.heartbeat_timeout:g} s"
            )
        return self


def identifiers(devices: Mapping[str, Device]) -> dict[int, str]:
    """The 11-bit identifiers that `devices` take, each with what it is; one id, one node."""
    taken = {NMT: "network management"} if devices else {}
    for name, device in devices.items():
        taken |= {
            HEARTBEAT + device.id: f"heartbeat of {name}",
            EMERGENCY + device.id: f"emergency of {name}",
            SDO_RESPONSE + device.id: f"SDO response of {name}",
            SDO_REQUEST + device.id: f"SDO request to {name}",
        }
    return taken


def check_nodes(devices: Mapping[str, Device]) -> None:
    """`ValueError` where two devices have the same node id."""
    owners: dict[int, str] = {}
    for name, device in devices.items():
        if device.id in owners:
            raise ValueError(f"{owners[device.id]} and {name} have the same node id {device.id}")
        owners[device.id] = name
