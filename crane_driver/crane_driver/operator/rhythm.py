"""How bring-up and jog send commands: often, and never after a pause that the driver minds."""

COMMAND_PERIOD_S = 0.01
LONGEST_PAUSE_S = 0.08  # between two commands; the driver refuses the next unless it is neutral
