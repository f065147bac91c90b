"""`film`: a bag as a film of the crane, beside it where its joints were and should have been."""

from collections.abc import Sequence
from pathlib import Path

from crane_model import cli
from crane_model.arguments import between
from crane_model.errors import DataError
from crane_model.progress_bar import progress_bar
from crane_sim.drawing.opengl import find_backend
from crane_sim.options import add_plant, load_both

SIZE = (640, 640)
LARGEST = 1600  # pixels
RATE = 12.5  # pictures a second
LENGTH, LONGEST = 20.0, 60.0  # s; all pictures are held in memory before they are written
QUALITY, EFFORT = 60, 4  # of WebP: 0 to 100, 0 to 6


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
        help="s into the bag (default: 0)",
    )
    parser.add_argument(
        "--length",
        type=between(1 / RATE, LONGEST),
        default=LENGTH,
        metavar="S",
        help=f"s at most (default: {LENGTH:g})",
    )
    parser.add_argument("--size", type=int, nargs=2, default=SIZE, metavar=("WIDTH", "HEIGHT"))
    add_plant(parser)
    cli.add_machine(parser)
    cli.add_replace(parser)
    arguments = parser.parse_args(argv)

    def body() -> None:
        if arguments.out.suffix.lower() != ".webp":
            raise DataError(f"{arguments.out}: the film is a WebP file; name it *.webp")
        cli.check_out(arguments.out, replace=arguments.replace)
        width, height = arguments.size
        if not all(100 <= side <= LARGEST for side in (width, height)):
            raise DataError(f"--size {width} {height}: each from 100 to {LARGEST} pixels")
        machine, parameters = load_both(arguments.machine, arguments.plant)
        find_backend()
        # only now: without OpenGL the import of mujoco may fail, and less clearly
        from crane_sim.drawing.frames import frames
        from crane_sim.drawing.shot import shot

        shown = shot(arguments.bag, machine, arguments.begin, arguments.length, RATE)
        with progress_bar(arguments.out.name, len(shown.time) + 1) as bar:
            pictures = []
            for picture in frames(shown, parameters, machine, width, height):
                pictures.append(picture)
                bar.update()
            pictures[0].save(
                arguments.out,
                save_all=True,
                append_images=pictures[1:],
                duration=round(1000 / RATE),
                loop=0,
                quality=QUALITY,
                method=EFFORT,
            )
            bar.update()
        size = arguments.out.stat().st_size / 1e6
        print(f"written: {arguments.out}, {len(pictures) / RATE:.1f} s, {size:.1f} MB")

    return cli.run(body)
