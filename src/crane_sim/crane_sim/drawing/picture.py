"""`picture`: the stand-in crane in one pose as a PNG file, drawn without a display."""

from collections.abc import Sequence
from pathlib import Path

from crane_model import cli
from crane_model.errors import DataError
from crane_model.progress_bar import progress_bar
from crane_sim.drawing.opengl import find_backend
from crane_sim.make_bag import add_plant, load_both
from crane_sim.parts.pose import parse_pose

SIZE = (1600, 1000)
LARGEST = 4000  # pixels
COLOURS = 256  # of the palette, which keeps the file small


def main(argv: Sequence[str] | None = None) -> int:
    """Draw the stand-in crane into a PNG file."""
    parser = cli.command_line(description=main.__doc__)
    parser.add_argument("--out", type=Path, required=True, help="PNG file to write")
    parser.add_argument(
        "--pose", nargs="+", default=[], metavar="JOINT=VALUE", help="rad, m; else at rest"
    )
    parser.add_argument("--size", type=int, nargs=2, default=SIZE, metavar=("WIDTH", "HEIGHT"))
    add_plant(parser)
    cli.add_machine(parser)
    cli.add_replace(parser)
    arguments = parser.parse_args(argv)

    def body() -> None:
        if arguments.out.suffix.lower() != ".png":
            raise DataError(f"{arguments.out}: the picture is a PNG file; name it *.png")
        if not arguments.out.parent.is_dir():
            raise DataError(f"{arguments.out}: there is no folder {arguments.out.parent}; make it")
        cli.check_out(arguments.out, replace=arguments.replace)
        width, height = arguments.size
        if not all(1 <= side <= LARGEST for side in (width, height)):
            raise DataError(f"--size {width} {height}: each from 1 to {LARGEST} pixels")
        machine, parameters = load_both(arguments.machine, arguments.plant)
        pose = parse_pose(arguments.pose, machine, parameters.start)
        find_backend()
        # only now: without OpenGL the import of mujoco may fail, and less clearly
        from PIL import Image

        from crane_sim.drawing.offscreen import FINENESS, take_picture
        from crane_sim.drawing.scene import Scene

        with progress_bar(arguments.out.name, 3) as bar:
            scene = Scene(parameters, machine, FINENESS * width, FINENESS * height)
            scene.set_pose(pose)
            bar.update()
            picture = take_picture(scene, width, height)
            bar.update()
            palette = picture.quantize(COLOURS, dither=Image.Dither.FLOYDSTEINBERG)
            palette.save(arguments.out, optimize=True)
            bar.update()
        print(f"written: {arguments.out}")

    return cli.run(body)
