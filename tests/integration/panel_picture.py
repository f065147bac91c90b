"""`python -m integration.panel_picture`, in tests: the operator's page for the manual, as it is.

Meanwhile, the simulated crane follows a trajectory.
"""

import os
import tempfile
from contextlib import ExitStack, closing
from pathlib import Path

from integration.browser import installed
from integration.driver_stage import Stage
from integration.experiments import Experiments
from integration.live_page import Page
from integration.panel_visits import served, until
from integration.processes import end

from crane_nodes import this_computer

PICTURE = Path(__file__).resolve().parents[2] / "docs" / "pictures" / "panel.png"
WINDOW = (1280, 868)  # down to the faults
RUNNING = "document.getElementById('phase').textContent.startsWith('excitation')"


def main() -> None:
    """Write the picture."""
    os.environ.update(this_computer.variables(os.environ))
    os.environ.setdefault("ROS_DOMAIN_ID", "0")
    with tempfile.TemporaryDirectory() as name, ExitStack() as stack:
        folder = Path(name)
        stage = stack.enter_context(closing(Stage(folder, [])))
        panel = stack.enter_context(served())
        experiments = Experiments(stage, folder)
        stack.callback(end, experiments.process)
        page = stack.enter_context(Page(installed(), panel.url, *WINDOW))
        experiments.moving()
        until(lambda: page.evaluate(RUNNING))
        PICTURE.write_bytes(page.picture())


if __name__ == "__main__":
    main()
