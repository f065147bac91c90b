"""`film`: a bag as a film of the crane, beside it where its joints were and should have been."""

import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from PIL import Image, ImageDraw

from crane_bags.reader import TopicData, namespace_of, read_topics
from crane_bags.types import JOINT_REFERENCE, JOINT_STATES
from crane_model import cli
from crane_model.cli import between
from crane_model.errors import DataError
from crane_model.machine import Machine
from crane_model.progress_bar import progress_bar
from crane_sim.drawing.picture import find_backend
from crane_sim.drawing.scene import FINENESS, Canvas, Scene
from crane_sim.parts.parameters import SimulatedCrane, add_plant, load_both

# Content of a film: measured and commanded positions of the joints at each picture.

MIN_SHOWN_MOTION = 0.02  # rad, m: a joint that has moved less is not worth a curve


class Shot(NamedTuple):
    """n pictures of j joints, from the base to the tip."""

    time: np.ndarray  # (n,) s, from the first
    position: np.ndarray  # (n, j) rad, m
    reference: np.ndarray  # (n, j) rad, m; NaN where there was none

    @property
    def moved(self) -> list[int]:
        """The joints that moved, by their columns; all of them if none did."""
        travel = np.ptp(self.position, axis=0)
        return [int(i) for i in np.flatnonzero(travel > MIN_SHOWN_MOTION)] or list(
            range(travel.size)
        )


def shot(bag: Path, machine: Machine, begin: float, length: float, rate: float) -> Shot:
    """`length` seconds of a bag from `begin`, `rate` pictures a second; fewer where it ends before.

    begin: s from the first joint states of the bag. `DataError` if it holds none then.
    """
    namespace = namespace_of(bag)
    states_topic = JOINT_STATES.within(namespace)
    reference_topic = JOINT_REFERENCE.within(namespace)
    read = read_topics(bag, [states_topic], [reference_topic])
    states = read[states_topic.name].select(machine.joint_names)
    start = int(states.stamp[0])
    seconds = (int(states.stamp[-1]) - start) * 1e-9
    if not 0.0 <= begin < seconds:
        raise DataError(
            f"{bag}: its joint states last {seconds:.1f} s, but the film is to begin at "
            f"{begin:g} s; let it begin before"
        )
    time = np.arange(begin, min(begin + length, seconds), 1 / rate)
    position = _at(time, states, start, machine)
    if not np.isfinite(position).all():
        lost = [name for name, q in zip(machine.joint_names, position.T, strict=True)
                if not np.isfinite(q).all()]  # fmt: skip
        raise DataError(f"{bag}: {', '.join(lost)} was not measured; film a bag in which it was")
    # a reading may lie beyond the limits, by its noise; the linkages are drawn within them
    low, high, *_ = machine.ranges()
    drawn = position.clip(low, high)
    reference = np.full_like(position, np.nan)
    if told := read.get(reference_topic.name):
        reference = _at(time, told, start, machine)
    return Shot(time - begin, drawn, reference)


def _at(time: np.ndarray, told: TopicData, start: int, machine: Machine) -> np.ndarray:
    """(n, j) positions at times [s], those between messages interpolated; NaN outside of them."""
    values = np.full((time.size, len(machine.joint_names)), np.nan)
    when = (told.stamp - start) * 1e-9
    for column, joint in enumerate(machine.joint_names):
        if joint not in told.names:
            continue
        position = told.fields["position"][:, told.names.index(joint)]
        known = np.isfinite(position)
        if known.any():
            values[:, column] = np.interp(
                time, when[known], position[known], left=np.nan, right=np.nan
            )
    return values


# The strip below a film: reference and measured position over time, and how far it has come.

DOTS_PER_INCH = 100  # per inch
STRIP_FINENESS = 2  # drawn so many times larger, then averaged, as the crane is
PAPER, INK, SOFT_INK = "#f7f6f2", "#1b1c1a", "#6b6c66"
REFERENCE, MEASURED, NOW = "#b9b6ab", "#1f5f8f", (143, 82, 0)
LEFT, RIGHT, TOP, BOTTOM = 0.17, 0.975, 0.86, 0.16  # of the strip: where curves are
FADED_SHARE = 0.78  # of the way to the paper, for what is still to come


class Strip:
    """Drawn once; each picture of a film shows it with another now."""

    def __init__(self, shot: Shot, machine: Machine, width: int, height: int):
        """width, height [pixels]."""
        self._seen = _drawn(shot, machine, width, height)
        paper = Image.new("RGB", self._seen.size, PAPER)
        self._coming = Image.blend(self._seen, paper, FADED_SHARE)
        # names and scales do not fade
        self._coming.paste(self._seen.crop((0, 0, round(LEFT * width), height)), (0, 0))
        for low, high in ((0.0, 1.0 - TOP), (1.0 - BOTTOM, 1.0)):
            rows = (0, round(low * height), width, round(high * height))
            self._coming.paste(self._seen.crop(rows), rows[:2])

    def at(self, share: float) -> Image.Image:
        """How it looks when this share (0 to 1) of the film has passed."""
        width, height = self._seen.size
        now = round((LEFT + share * (RIGHT - LEFT)) * width)
        strip = self._coming.copy()
        strip.paste(self._seen.crop((0, 0, now, height)), (0, 0))
        ends = (now, round((1.0 - TOP) * height), now, round((1.0 - BOTTOM) * height))
        ImageDraw.Draw(strip).line(ends, NOW, 1)
        return strip


def _drawn(shot: Shot, machine: Machine, width: int, height: int) -> Image.Image:
    from matplotlib.figure import Figure  # half a second to import

    figure = Figure(
        (width / DOTS_PER_INCH, height / DOTS_PER_INCH),
        dpi=STRIP_FINENESS * DOTS_PER_INCH,
        facecolor=PAPER,
    )
    joints = shot.moved
    figure.subplots_adjust(LEFT, BOTTOM, RIGHT, TOP, hspace=0.25)
    lanes = figure.subplots(len(joints), sharex=True, squeeze=False)[:, 0]
    for axes, joint in zip(lanes, joints, strict=True):
        name = machine.joint_names[joint]
        axes.plot(shot.time, shot.reference[:, joint], color=REFERENCE, lw=3.5)
        axes.plot(shot.time, shot.position[:, joint], color=MEASURED, lw=1.2)
        axes.set_ylabel(
            f"{name.replace('_', ' ')}\n{machine.units[name]}",
            rotation=0, ha="right", va="center", fontsize=8, color=INK,
        )  # fmt: skip
        axes.set_facecolor(PAPER)
        axes.margins(x=0.0, y=0.12)
        axes.locator_params(axis="y", nbins=2)
        axes.tick_params(labelsize=7, colors=SOFT_INK, length=2, labelbottom=axes is lanes[-1])
        for side, spine in axes.spines.items():
            spine.set_visible(side in ("left", "bottom"))
            spine.set_color(REFERENCE)
    lanes[-1].set_xlabel("s", fontsize=8, color=SOFT_INK, labelpad=0)
    words = [("measured", MEASURED)]
    if np.isfinite(shot.reference).any():
        words.append(("reference", SOFT_INK))
    for place, (word, colour) in enumerate(words):
        figure.text(LEFT + 0.12 * place, 0.91, word, fontsize=8, color=colour, weight="bold")
    drawn = io.BytesIO()
    figure.savefig(drawn, format="png")
    return Image.open(drawn).convert("RGB").reduce(STRIP_FINENESS)


# The pictures of a film, one after the other.

CURVES_HEIGHT = 0.27  # of the height


def frames(
    shot: Shot, parameters: SimulatedCrane, machine: Machine, width: int, height: int
) -> Iterator[Image.Image]:
    """The crane at each moment of a shot, and its curves below [pixels]."""
    below = round(CURVES_HEIGHT * height)
    above = height - below
    fine = FINENESS * width, FINENESS * above
    strip = Strip(shot, machine, width, below)
    scene = Scene(parameters, machine, *fine)
    camera = scene.camera_of(shot.position, width / above)
    with Canvas(scene, *fine) as canvas:
        for number, q in enumerate(shot.position):
            scene.set_pose(q)
            picture = Image.new("RGB", (width, height))
            picture.paste(Image.fromarray(canvas.draw(camera)).reduce(FINENESS), (0, 0))
            picture.paste(strip.at(number / max(len(shot.time) - 1, 1)), (0, above))
            yield picture


FILM_SIZE = (640, 640)
MAX_FILM_SIDE = 1600  # pixels
FRAMES_PER_S = 12.5  # pictures a second
FILM_S, MAX_FILM_S = 20.0, 60.0  # s; all pictures are held in memory before they are written
QUALITY, EFFORT = 60, 4  # of WebP: 0 to 100, 0 to 6


@dataclass(frozen=True)
class _Request:
    bag: Path
    out: Path
    begin: float  # s
    length: float  # s
    size: Sequence[int]  # pixels: width, height
    plant: Path | None
    machine: str | None
    replace: bool


def main(argv: Sequence[str] | None = None) -> int:
    """Draw the motion of a bag into an animated WebP file, which browsers play."""
    parser = cli.command_line(description=main.__doc__)
    parser.add_argument("--bag", type=Path, required=True, help="recording of the crane")
    parser.add_argument("--out", type=Path, required=True, help="WebP file to write")
    parser.add_argument(
        "--begin",
        type=between(0.0, 1e7),
        default=0.0,
        metavar="S",
        help="start within the bag [s] (default: 0)",
    )
    parser.add_argument(
        "--length",
        type=between(1 / FRAMES_PER_S, MAX_FILM_S),
        default=FILM_S,
        metavar="S",
        help=f"largest duration [s] (default: {FILM_S:g})",
    )
    parser.add_argument(
        "--size", type=int, nargs=2, default=FILM_SIZE, metavar=("WIDTH", "HEIGHT"),
        help="size of the film [pixels] (default: {} {})".format(*FILM_SIZE),
    )  # fmt: skip
    add_plant(parser)
    cli.add_machine(parser)
    cli.add_replace(parser)
    request = _Request(**vars(parser.parse_args(argv)))

    def body() -> None:
        if request.out.suffix.lower() != ".webp":
            raise DataError(f"{request.out}: the film is a WebP file; name it *.webp")
        cli.check_out(request.out, replace=request.replace)
        width, height = request.size
        if not all(100 <= side <= MAX_FILM_SIDE for side in (width, height)):
            raise DataError(f"--size {width} {height}: each from 100 to {MAX_FILM_SIDE} pixels")
        machine, parameters = load_both(request.machine, request.plant)
        find_backend()
        shown = shot(request.bag, machine, request.begin, request.length, FRAMES_PER_S)
        with progress_bar(request.out.name, len(shown.time) + 1) as bar:
            pictures = []
            for picture in frames(shown, parameters, machine, width, height):
                pictures.append(picture)
                bar.update()
            pictures[0].save(
                request.out,
                save_all=True,
                append_images=pictures[1:],
                duration=round(1000 / FRAMES_PER_S),
                loop=0,
                quality=QUALITY,
                method=EFFORT,
            )
            bar.update()
        size = request.out.stat().st_size / 1e6
        print(f"written: {request.out}, {len(pictures) / FRAMES_PER_S:.1f} s, {size:.1f} MB")

    return cli.run(body)
