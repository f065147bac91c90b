"""The strip below a film: reference and measured position over time, and how far it has come."""

import io

import numpy as np
from matplotlib.figure import Figure
from PIL import Image, ImageDraw

from crane_model.machine import Machine
from crane_sim.drawing.shot import Shot

DOTS = 100  # per inch
FINENESS = 2  # drawn so many times larger, then averaged, as the crane is
PAPER, INK, SOFT = "#f7f6f2", "#1b1c1a", "#6b6c66"
REFERENCE, MEASURED, NOW = "#b9b6ab", "#1f5f8f", (143, 82, 0)
LEFT, RIGHT, TOP, BOTTOM = 0.17, 0.975, 0.86, 0.16  # of the strip: where curves are
FADED = 0.78  # of the way to the paper, for what is still to come


class Strip:
    """Drawn once; each picture of a film shows it with another now."""

    def __init__(self, shot: Shot, machine: Machine, width: int, height: int):
        """width, height [pixels]."""
        self._seen = _drawn(shot, machine, width, height)
        paper = Image.new("RGB", self._seen.size, PAPER)
        self._coming = Image.blend(self._seen, paper, FADED)
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
    figure = Figure((width / DOTS, height / DOTS), dpi=FINENESS * DOTS, facecolor=PAPER)
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
        axes.tick_params(labelsize=7, colors=SOFT, length=2, labelbottom=axes is lanes[-1])
        for side, spine in axes.spines.items():
            spine.set_visible(side in ("left", "bottom"))
            spine.set_color(REFERENCE)
    lanes[-1].set_xlabel("s", fontsize=8, color=SOFT, labelpad=0)
    words = [("measured", MEASURED)]
    if np.isfinite(shot.reference).any():
        words.append(("reference", SOFT))
    for place, (word, colour) in enumerate(words):
        figure.text(LEFT + 0.12 * place, 0.91, word, fontsize=8, color=colour, weight="bold")
    drawn = io.BytesIO()
    figure.savefig(drawn, format="png")
    return Image.open(drawn).convert("RGB").reduce(FINENESS)
