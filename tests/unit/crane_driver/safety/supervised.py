"""A supervisor with a clock that the test moves."""

import math

from crane_driver import Fault, FaultKind, load_safety
from crane_driver.safety.supervisor import Output, Supervisor
from crane_model import load_machine
from crane_model.machine_files import machine_file

JOINTS = load_machine().joint_names
MACHINE, SAFETY = load_machine(), load_safety(machine_file("safety.yaml"), load_machine())
CYCLE = 0.005  # s
MIDDLE = {
    joint: (MACHINE.limits[joint].position_min + MACHINE.limits[joint].position_max) / 2
    for joint in JOINTS
}
STILL = dict.fromkeys(JOINTS, 0.0)
NEUTRAL = Output(STILL, enabled=False)
CAN_FAULT = Fault(FaultKind.CHECKSUM, "Crc is 0x00", "EncoderBase", "120", "encoder of slew")


class Bench:
    def __init__(self) -> None:
        self.now = 50.0
        self.it = Supervisor(JOINTS, MACHINE, SAFETY, self.now)
        self.it.readings(MIDDLE, STILL)

    def run(self, seconds: float, command: dict[str, float] | None = None) -> list[Output]:
        """Cycles of the bus, with a command in each if there is one."""
        outputs = []
        for _ in range(math.ceil(seconds / CYCLE)):
            self.now += CYCLE
            self.it.ready(True, self.now)
            if command is not None:
                self.command(**command)
            outputs.append(self.it.output(self.now))
        return outputs

    def slew(self, position: float, velocity: float) -> None:
        """Measured [rad, rad/s]; the other joints stand in the middle of their ranges."""
        self.it.readings({**MIDDLE, "slew": position}, {**STILL, "slew": velocity})

    def command(self, **values: float) -> None:
        self.it.command(list(values), list(values.values()), self.now)

    def enabled(self) -> "Bench":
        self.run(SAFETY.settling_time + 2 * CYCLE)
        self.it.enable(self.now)
        self.run(2 * CYCLE, {"slew": 0.0})
        return self

    def moving(self) -> "Bench":
        """Enabled, with the slew valve fully open."""
        assert self.enabled().run(1.0, {"slew": 1.0})[-1] == Output({**STILL, "slew": 1.0}, True)
        return self
