"""The pictures of a film, one after the other."""

from collections.abc import Iterator

from PIL import Image

from crane_model.machine import Machine
from crane_sim.drawing.offscreen import FINENESS, Canvas
from crane_sim.drawing.scene import Scene
from crane_sim.drawing.shot import Shot
from crane_sim.drawing.strip import Strip
from crane_sim.parts.parameters import StandIn

CURVES = 0.27  # of the height


def frames(
    shot: Shot, parameters: StandIn, machine: Machine, width: int, height: int
) -> Iterator[Image.Image]:
    """The crane at each moment of a shot, and its curves below [pixels]."""
    below = round(CURVES * height)
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
