"""Trajectories and bags of the study; what is there already is not made again."""

import os
import shutil
import subprocess
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from ament_index_python.packages import get_package_prefix

from crane_model.configuration import load
from crane_trajectory.motion.periodic import FourierTrajectory

Advance = Callable[[], object]

CRITERION = "a-optimality"
"""Predicted standard deviations are what counts in the end."""


class StudyError(Exception):
    """An executable of the study failed."""


@dataclass(frozen=True)
class StudyPlan:
    """Trajectories of `period` s with `harmonics`, best of `starts`, recorded for `periods`."""

    period: float
    harmonics: int
    starts: int
    periods: int


@dataclass(frozen=True)
class Campaign:
    """`count` trajectories designed in sequence, and a bag of each; `seed` of both."""

    name: str
    count: int
    seed: int
    folder: Path

    @property
    def designs(self) -> Path:
        return self.folder / "trajectories" / self.name

    @property
    def trajectories(self) -> list[Path]:
        """Their files, in the order in which they were designed."""
        return sorted(self.designs.glob("*.yaml"))

    @property
    def designed(self) -> list[FourierTrajectory]:
        """The trajectories, in the same order."""
        return [load(file, FourierTrajectory) for file in self.trajectories]

    @property
    def bags(self) -> list[Path]:
        """Their bags, in the same order."""
        return [self.folder / "bags" / file.stem for file in self.trajectories]


def run(package: str, executable: str, *arguments: object) -> str:
    """Run one executable of the suite to its end and return what it printed."""
    path = Path(get_package_prefix(package)) / "lib" / package / executable
    command = [str(path), *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        raise StudyError(f"{package} {executable} failed ({done.returncode}):\n{done.stderr}")
    return done.stdout


def design(campaign: Campaign, experiment: StudyPlan) -> None:
    """Each trajectory for the information that the earlier ones lack."""
    with made_once(campaign.designs) as out:
        if out is not None:
            run(
                *("crane_trajectory", "design", "--out", out, "--count", campaign.count),
                *("--period", experiment.period, "--harmonics", experiment.harmonics),
                *("--starts", experiment.starts, "--seed", campaign.seed),
                *("--criterion", CRITERION),
            )


def record(campaigns: Sequence[Campaign], experiment: StudyPlan, advance: Advance) -> None:
    """A bag of each trajectory with the simulated crane, on all cores; `advance` after each."""
    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        futures = [
            pool.submit(_bag, trajectory, bag, experiment.periods, campaign.seed + number)
            for campaign in campaigns
            for number, (trajectory, bag) in enumerate(
                zip(campaign.trajectories, campaign.bags, strict=True)
            )
        ]
        for future in as_completed(futures):
            future.result()
            advance()


def _bag(trajectory: Path, bag: Path, periods: int, seed: int) -> None:
    with made_once(bag) as out:
        if out is not None:
            run(
                *("crane_sim", "make_bag", "--trajectory", trajectory, "--out", out),
                *("--periods", periods, "--seed", seed),
            )


@contextmanager
def made_once(folder: Path) -> Iterator[Path | None]:
    """Folder to write `folder` into until it is complete; None if it is there already."""
    if folder.exists():
        yield None
        return
    unfinished = folder.parent / "unfinished" / folder.name
    shutil.rmtree(unfinished, ignore_errors=True)  # of a study that was interrupted
    unfinished.parent.mkdir(parents=True, exist_ok=True)
    yield unfinished
    unfinished.rename(folder)
