"""The crane on its CAN bus: frames to readings, safe commands to frames.

A command as the driver sends it, and as the machine at the other end of the bus reads it:

>>> from crane_driver import DriverCodec, MachineCodec, load_layout
>>> from crane_model import load_machine
>>> from crane_model.machine_files import machine_file
>>> layout = load_layout(load_machine(), machine_file("can.yaml"), machine_file("can.dbc"))
>>> (frame,) = DriverCodec(layout).command_frames({"telescope": 0.25}, enabled=True)
>>> read = MachineCodec(layout).decode(frame)
>>> read.commands["telescope"], read.enabled
(0.25, True)

Velocity from encoder readings; a fault with what to do about it:

>>> import numpy as np
>>> from crane_driver import FaultKind, VelocityFilter
>>> follow = VelocityFilter([0.1], [1e-5])
>>> for k in range(200):
...     position, velocity, acceleration = follow.update(0.005 * k, [0.2 * 0.005 * k])
>>> velocity.round(3).tolist()
[0.2]
>>> FaultKind.FROZEN.remedy
'check that the encoder turns, the joint is free and the engine runs'
"""

from typing import TYPE_CHECKING

from crane_model.lazily import lazily

if TYPE_CHECKING:
    from crane_driver.can.binding import load_layout as load_layout
    from crane_driver.can.bus import BusSettings as BusSettings
    from crane_driver.can.codec import DriverCodec as DriverCodec
    from crane_driver.can.codec import MachineCodec as MachineCodec
    from crane_driver.can.link import Link as Link
    from crane_driver.faults import Fault as Fault
    from crane_driver.faults import FaultKind as FaultKind
    from crane_driver.safety.commands import SafetySettings as SafetySettings
    from crane_driver.safety.commands import load_safety as load_safety
    from crane_driver.velocity_filter import VelocityFilter as VelocityFilter

__getattr__, __dir__, __all__ = lazily(__name__, __file__)
