"""What the sensor monitor said of each recording, kept, so that an interrupted run goes on."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from pydantic import TypeAdapter

from crane_benchmark.scores.frozen import digest_of_code
from crane_model.errors import ConfigurationError
from crane_observer import monitor
from crane_observer.monitor.finding import SensorFinding

CODE = "monitor.sha256"  # of the code that the answers in a folder are by


class WatchedWork(NamedTuple):
    """A recording."""

    begin: float  # s since the machine was started
    seconds: float
    findings: list[SensorFinding]  # times as in the recording


ANSWER = TypeAdapter(WatchedWork)


class KeptAnswers:
    """In a folder, a file for each recording; several processes may work on different ones."""

    def __init__(self, folder: Path):
        """`ConfigurationError` if the folder holds answers of another monitor."""
        sources = sorted(Path(next(iter(monitor.__path__))).glob("*.py"))
        code = digest_of_code(one.read_text() for one in sources)
        folder.mkdir(parents=True, exist_ok=True)
        file = folder / CODE
        if not file.exists():
            file.write_text(code)
        if file.read_text() != code:
            raise ConfigurationError(
                f"{folder}: holds answers of a monitor that was another program; name a new folder"
            )
        self.folder = folder

    def answer(self, name: str, watched: Callable[[], WatchedWork]) -> WatchedWork:
        """To the recording of that name, given now unless it was before."""
        file = self.folder / f"{name}.json"
        if file.exists():
            return ANSWER.validate_json(file.read_bytes())
        found = watched()
        unfinished = file.with_suffix(".unfinished")
        unfinished.write_bytes(ANSWER.dump_json(found))
        os.replace(unfinished, file)
        return found
