"""Layout of the page: the crane on the left, its signals in columns next to it."""

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from crane_model.machine import Machine
from crane_viewer import paths
from crane_viewer.scene import reached_places

MEASURED, REFERENCE, PREDICTED = (38, 70, 102), (226, 113, 29), (194, 40, 31)
CHAMBER_A, CHAMBER_B = (31, 119, 140), (150, 96, 164)
OF_JOINTS = (
    (31, 95, 168),
    (226, 113, 29),
    (42, 143, 89),
    (150, 96, 164),
    (194, 40, 31),
    (90, 90, 90),
)
LIVE_SECONDS = 20  # of every plot, while topics are shown
PAPER = (244, 246, 248)
STATES = {
    "enabled": (42, 143, 89),
    "degraded": (226, 113, 29),
    "disabled": (138, 148, 158),
    "listening": (70, 130, 180),
    "offline": (196, 160, 60),
    "fault": (194, 40, 31),
    "emergency stop": (150, 10, 10),
} | dict.fromkeys(("unconfigured", "inactive", "finalized"), (200, 205, 210))  # else any colour


def style(recording: rr.RecordingStream, machine: Machine) -> None:
    """Names and colours of all lines, once."""

    def lines(path: str, names: list[str], colours: list[tuple[int, int, int]]) -> None:
        of_all = rr.SeriesLines(names=names, colors=colours, widths=[1.6] * len(names))
        recording.log(path, of_all, static=True)

    for joint in machine.joint_names:
        lines(paths.reference(joint), ["reference"], [REFERENCE])
        lines(paths.position(joint), ["measured"], [MEASURED])
        lines(paths.measured_force(joint), ["measured"], [MEASURED])
        lines(paths.predicted_force(joint), ["predicted"], [PREDICTED])
        lines(paths.pressures(joint), ["chamber A", "chamber B"], [CHAMBER_A, CHAMBER_B])
    colours = [OF_JOINTS[i % len(OF_JOINTS)] for i in range(len(machine.joint_names))]
    lines(paths.COMMANDS, list(machine.joint_names), colours)
    states = rr.StateConfiguration(values=list(STATES), colors=list(STATES.values()))
    recording.log(paths.STATE, states, static=True)


def blueprint(machine: Machine, live: bool) -> rrb.Blueprint:
    """Views and their places; `live` ones show the last seconds and follow."""
    ranges = [_last_seconds()] if live else None

    def plot(
        name: str, contents: str, axis: rrb.ScalarAxis | None = None, named: bool = True
    ) -> rrb.TimeSeriesView:
        return rrb.TimeSeriesView(
            name=name,
            contents=contents,
            time_ranges=ranges,
            plot_legend=rrb.PlotLegend(rrb.Corner2D.LeftTop, visible=named),
            axis_y=axis,
        )

    units = machine.units
    pressured = [
        joint for joint, cylinder in machine.cylinders.items() if cylinder.pressure_sensors
    ]
    motion = [plot(f"{joint} [{units[joint]}]", f"positions/{joint}/**") for joint in units]
    forces = [
        plot(f"{joint} [{'N m' if units[joint] == 'rad' else 'N'}]", f"forces/{joint}/**")
        for joint in pressured
    ]
    pressures = [plot(f"{joint} [MPa]", paths.pressures(joint)) for joint in pressured]
    commands = plot("valve commands [-]", paths.COMMANDS, rrb.ScalarAxis(range=(-1.0, 1.0)))
    settling = plot(
        "σ / |Θ| [%]", paths.UNCERTAINTY, rrb.ScalarAxis(range=(0.0, 25.0)), named=False
    )
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(
                _space(machine),
                rrb.StateTimelineView(origin=paths.STATE, name="driver"),
                rrb.Tabs(
                    rrb.TextLogView(
                        origin=paths.EVENTS,
                        name="faults and events",
                        columns=rrb.TextLogColumns(text_log_columns=["LogLevel", "Body"]),
                    ),
                    rrb.TextDocumentView(origin=paths.NOW, name="driver now"),
                ),
                row_shares=[6, 1, 2],
            ),
            rrb.Vertical(*motion, name="reference and position"),
            rrb.Vertical(
                rrb.Tabs(
                    *(
                        [rrb.Vertical(*forces, name="measured and predicted force")]
                        if forces
                        else []
                    ),
                    *([rrb.Vertical(*pressures, name="chamber pressures")] if pressures else []),
                    rrb.TextDocumentView(origin=paths.ESTIMATE, name="Θ"),
                ),
                commands,
                settling,
                row_shares=[4, 2, 2],
            ),
            column_shares=[5, 3, 3],
        ),
        rrb.TimePanel(state="collapsed", timeline=paths.TIMELINE, play_state="following"),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        auto_views=False,
    )


def _space(machine: Machine) -> rrb.Spatial3DView:
    eye, target = _eye(machine)
    return rrb.Spatial3DView(
        name=machine.name,
        origin="/",
        contents=["robot/**", "scene/**", f"{paths.JOINT_FRAMES}/**", "tf_static"],
        background=PAPER,
        spatial_information=rrb.SpatialInformation(target_frame=paths.BASE_FRAME),
        eye_controls=rrb.EyeControls3D(position=eye, look_target=target, eye_up=(0.0, 0.0, 1.0)),
    )


def _eye(machine: Machine) -> tuple[np.ndarray, np.ndarray]:
    """Position of the eye and its target: all that is reached, slightly from the front."""
    places = reached_places(machine)
    low, high = places.min(axis=0), places.max(axis=0)
    reach = float(np.hypot(places[:, 0], places[:, 1]).max())
    top = max(float(high[2]), 0.0)
    target = np.array([0.35 * reach, 0.0, 0.35 * top])
    size = max(reach, top - min(float(low[2]), 0.0))
    return target + size * np.array([0.65, -1.1, 0.5]), target


def _last_seconds() -> rrb.VisibleTimeRange:
    return rrb.VisibleTimeRange(
        paths.TIMELINE,
        start=rrb.TimeRangeBoundary.cursor_relative(seconds=-LIVE_SECONDS),
        end=rrb.TimeRangeBoundary.cursor_relative(),
    )
