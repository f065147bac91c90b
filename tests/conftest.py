import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from heartbeat import Heartbeat
from hypothesis import HealthCheck, settings
from left_behind import none_left_behind
from rich.console import Console
from rich.table import Table

from crane_benchmark.measured import MeasuredRow, write
from crane_nodes import this_computer

# The same examples on every machine; the first call of compiled code takes seconds.
settings.register_profile(
    "suite", derandomize=True, deadline=None, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("suite")

ROOT = Path(__file__).resolve().parents[1]


# They begin, so that the workers of a parallel run end at nearly the same time. In a fresh clone
# the first compiles what the others would each compile for themselves, if they began beside it.
LONGEST = (
    "test_rehearse.py",
    "test_lock_step.py",
    "test_study.py",
    "test_player.py",
    "test_recorder.py",
    "test_tutorials.py",
    "test_discrepancy_benchmark.py",
    "test_diagnose.py",
    "test_cluster.py",
    "test_discriminate.py",
    "test_report_page.py",
    "test_identify.py",
    "test_identification_node.py",
    "test_jog.py",
    "test_sensor_monitor.py",
    "test_trajectory_node.py",
    "test_trajectory_defects.py",
    "test_following.py",
    "test_panel.py",
    "test_bringup.py",
    "test_demo.py",
)
MEASURED = ROOT / "runs" / "bench"  # for the manual: `make figures`
ROWS = pytest.StashKey[dict[str, dict[str, MeasuredRow]]]()


def pytest_configure(config: pytest.Config) -> None:
    """A log of a parallel run gets a line from time to time: dots alone end no line for minutes."""
    if config.getoption("numprocesses", None) and not sys.stdout.isatty():
        config.pluginmanager.register(Heartbeat())


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The longest files first; what runs in the order of its file stays so."""
    rank = {name: place for place, name in enumerate(LONGEST)}
    items.sort(key=lambda item: rank.get(item.path.name, len(rank)))


@pytest.fixture
def measured(request: pytest.FixtureRequest) -> Callable[..., None]:
    """`measured(what, target, text, **values)`: a number that the project promises.

    The text is that of a cell of `MeasuredRow`. It stands in the table at the end of the run, and
    in runs/bench.
    """
    rows = request.config.stash.setdefault(ROWS, {}).setdefault(request.path.stem, {})

    def add(what: str, target: str, text: str, **values: float) -> None:
        plain = {name: float(value) for name, value in values.items()}
        rows[what] = MeasuredRow(cells=[what, target, text], values=plain)  # the last one of reruns

    return add


def pytest_terminal_summary(config: pytest.Config) -> None:
    if not (found := config.stash.get(ROWS, {})):
        return
    table = Table("quantity", "target", "measured", "by", title="What was measured", width=150)
    for name, rows in found.items():
        for row in rows.values():
            table.add_row(*row.shown, name)
        write(MEASURED / f"{name}.json", "make bench", list(rows.values()))
    Console(width=150, highlight=False).print(table)


@pytest.fixture(scope="session", autouse=True)
def _none_left_behind() -> Iterator[None]:
    """Nodes of a killed run would publish into the domain of a later one."""
    with none_left_behind():
        yield


@pytest.fixture(scope="session")
def real_data() -> Path:
    """Folder of measured data from real machines: CRANE_REAL_DATA, or ../shared/data."""
    folder = Path(os.environ.get("CRANE_REAL_DATA", ROOT.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"no real data in {folder}; set CRANE_REAL_DATA to the folder that holds it")
    return folder


@pytest.fixture(scope="session")
def ros_domain() -> Iterator[int]:
    """A ROS domain of this test process alone, for its nodes and the processes it starts."""
    domain_coordinator = pytest.importorskip("domain_coordinator")
    with domain_coordinator.domain_id() as domain, pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_DOMAIN_ID", str(domain))
        for name, value in this_computer.variables(os.environ).items():
            patch.setenv(name, value)
        yield domain
