"""Spool commands as they come: checked as a whole, and how they go back to neutral."""

from collections.abc import Collection, Sequence

from crane_model.errors import ConfigurationError, CraneError, RangeError


class RefusedError(CraneError):
    """A request to the driver was refused; nothing has changed.

    Examples: enabling while a command is not neutral, resetting while the ramp runs, a command
    with a value that is not a number.
    """


def check_valves(valves: Sequence[str], positions: Sequence[str]) -> None:
    """`ConfigurationError` where a joint has a valve but no position to keep its limits by."""
    if blind := [joint for joint in valves if joint not in positions]:
        raise ConfigurationError(
            f"mapping: {', '.join(blind)} can be commanded, but there is no position to keep the "
            "limits of Table 2 by; map one, or take the command out"
        )


def check_command(
    names: Sequence[str], values: Sequence[float], valves: Collection[str]
) -> dict[str, float]:
    """The commands by joint; joints of `valves` that are not named are neutral.

    `RangeError` refuses the whole command and names the joint, the limits and the value.
    """
    if len(names) != len(values):
        raise RangeError(
            f"valve command has {len(names)} names and {len(values)} values; one value a name"
        )
    commands = dict.fromkeys(valves, 0.0)
    seen: set[str] = set()
    for name, value in zip(names, values, strict=True):
        if name not in commands:
            raise RangeError(
                f"valve command for '{name}', but there are valves for {', '.join(valves)}"
            )
        if name in seen:
            raise RangeError(f"valve command names {name} twice")
        if not -1.0 <= value <= 1.0:  # refuses what is not a number, too
            raise RangeError(f"valve command for {name} is {value}, limits -1 and 1")
        seen.add(name)
        commands[name] = float(value)
    return commands


def ramped(command: float, step: float) -> float:
    """A spool command that is `step` nearer to neutral, and never beyond it."""
    return max(command - step, 0.0) if command > 0.0 else min(command + step, 0.0)
