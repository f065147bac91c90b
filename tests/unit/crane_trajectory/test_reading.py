"""A trajectory file that is read in a process of its own."""

import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from crane_model import ConfigurationError
from crane_model.machine_files import machine_file
from crane_trajectory import load_trajectory
from crane_trajectory.motion.periodic import read_apart

TRIES = 5
SHIPPED = sorted(
    file
    for pattern in ("excitation*.yaml", "validation*.yaml", "sweep*.yaml")
    for file in machine_file("model.yaml").parent.parent.glob(f"*/{pattern}")
)


@pytest.mark.parametrize("file", SHIPPED, ids=lambda file: f"{file.parent.name}/{file.name}")
def test_it_reads_the_same(file: Path) -> None:
    assert read_apart(file) == load_trajectory(file)


@pytest.mark.parametrize(
    "text", ["name: [1", "name: x\nperiod: 0.1\njoints: {}\n", "", "\x00", "kind: sweep\n"]
)
def test_it_refuses_the_same(text: str, tmp_path: Path) -> None:
    file = tmp_path / "wrong.yaml"
    file.write_text(text)
    told = []
    for read in (load_trajectory, read_apart):
        with pytest.raises(ConfigurationError) as caught:
            read(file)
        told.append(str(caught.value))
    assert told[0] == told[1]


def test_no_path_at_all_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="cannot be read: embedded null byte"):
        read_apart("\x00")


def test_a_path_longer_than_any_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="cannot be read: .* too long"):
        read_apart("x" * 300)
    with pytest.raises(ConfigurationError, match=r"xxx \.\.\. \[\d+ characters left out"):
        read_apart("x" * 3_000_000)


def test_a_file_that_takes_for_ever_is_given_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("crane_trajectory.motion.periodic.LONGEST_WAIT", 0.01)
    with pytest.raises(ConfigurationError, match=r"cannot be read within 0\.01 s"):
        read_apart(SHIPPED[0])


def longest_wait(work: Callable[[], object]) -> float:
    """s for which another thread of this process was held up meanwhile."""
    waits, done = [0.0], threading.Event()

    def beat() -> None:
        before = time.perf_counter()
        while not done.is_set():
            time.sleep(1e-3)
            now = time.perf_counter()
            waits.append(now - before)
            before = now

    thread = threading.Thread(target=beat)
    thread.start()
    with pytest.raises(ConfigurationError):
        work()
    done.set()
    thread.join()
    return max(waits)


def test_a_file_full_of_aliases_holds_up_no_other_thread(tmp_path: Path) -> None:
    """In 6 kB, 80 000 keys that are wrong, which takes a second to say."""
    keys = ", ".join(f"k{i}: 1" for i in range(200))
    joints = "".join(f"  j{i}: *a\n" for i in range(400))
    file = tmp_path / "aliases.yaml"
    file.write_text(f"name: t\nperiod: 20.0\njoints:\n  a: &a {{{keys}}}\n{joints}")
    here = longest_wait(lambda: load_trajectory(file))
    # A busy test machine holds up a thread, too, but hardly every time.
    assert any(longest_wait(lambda: read_apart(file)) < 0.5 * here for _ in range(TRIES))
