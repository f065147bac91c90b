"""What an operator does at the machine itself: its levers, its engine, and plugs that he pulls."""

from collections.abc import Iterable, Sequence
from typing import TextIO

from crane_model.errors import ConfigurationError, RangeError
from crane_sim.faulty.faults import Faults


class Operator:
    """Moves levers as lines of text say: `inner_boom=0.2`, `inner_boom=0`, `engine=off`.

    A lever moves the spool itself, positive in the positive direction of the joint, whatever the
    valve is commanded. While the engine is off the crane lies on its supports, and its chambers
    are vented: nothing moves, and all pressures are those of the air. `fault=TARGET.PART.KIND`
    makes a sensor or a valve fail from now on, `mended=TARGET.PART` or `mended=all` mends it.
    """

    def __init__(self, joints: Sequence[str], faults: Faults | None = None):
        self.levers = dict.fromkeys(joints, 0.0)
        self.engine = True
        self._faults = faults

    def obey(self, line: str) -> None:
        """Do what one line says; `RangeError` or `ConfigurationError` says what can be said."""
        name, _, value = (part.strip() for part in line.partition("="))
        if self._faults is not None and name == "fault":
            print(f"fault: {self._faults.add(value)}", flush=True)
            return
        if self._faults is not None and name == "mended":
            self._faults.mend(value)
            print(f"mended: {value}", flush=True)
            return
        if name == "engine" and value in ("on", "off"):
            self.engine = value == "on"
            return
        try:
            opening = float(value)
        except ValueError:
            opening = 2.0
        if name not in self.levers or not -1.0 <= opening <= 1.0:
            raise RangeError(
                f"'{line.strip()}': write engine=on, engine=off, fault=TARGET.PART.KIND, "
                "mended=TARGET.PART, or JOINT=OPENING with a joint of "
                f"{', '.join(self.levers)} and an opening from -1 to 1"
            )
        self.levers[name] = opening

    def follow(self, lines: TextIO, complaints: TextIO) -> None:
        """Obey every line until there are no more; a wrong one changes nothing."""
        for line in lines:
            try:
                self.obey(line)
            except (ConfigurationError, RangeError) as error:
                print(error, file=complaints, flush=True)

    def spools(self, commands: Sequence[float]) -> Iterable[float]:
        """(j,) where the spools are held: by the lever where it is moved, else by the command."""
        levers = self.levers.values()
        return [lever or command for lever, command in zip(levers, commands, strict=True)]
