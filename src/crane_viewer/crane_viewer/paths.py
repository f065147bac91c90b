"""Names of what is shown, in Rerun's tree of entities."""

TIMELINE = "time"
BASE_FRAME = "base_link"  # of the URDF

CYLINDERS = "scene/cylinders"
REACH = "scene/reach"
TIP = "scene/tip"
TRAIL = "scene/trail"
ROBOT = "robot"
JOINT_FRAMES = "joint_frames"
COMMANDS = "valve_commands"
UNCERTAINTY = "parameters/uncertainty"
ESTIMATE = "parameters/estimate"
STATE = "driver/state"
NOW = "driver/now"
EVENTS = "events"


def position(joint: str) -> str:
    """Measured [rad or m]."""
    return f"positions/{joint}/measured"


def reference(joint: str) -> str:
    """Topic of the controller's reference [rad or m]."""
    return f"positions/{joint}/reference"


def pressures(joint: str) -> str:
    """Chambers A and B [MPa]."""
    return f"pressures/{joint}"


def measured_force(joint: str) -> str:
    """From the pressures [N m or N]."""
    return f"forces/{joint}/measured"


def predicted_force(joint: str) -> str:
    """By the model with the estimate of that moment [N m or N]."""
    return f"forces/{joint}/predicted"
