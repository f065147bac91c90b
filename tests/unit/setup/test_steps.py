"""Steps of a target of make, and of its tests, tell what they do and why they failed."""

import subprocess
from pathlib import Path

from heartbeat import Heartbeat

STEP = Path(__file__).resolve().parents[3] / "scripts" / "step.sh"


def run(folder: Path, script: str) -> tuple[int, list[str], list[str]]:
    done = subprocess.run(
        ["bash", "-c", f"source '{STEP}'; {script}"], cwd=folder, capture_output=True, text=True
    )
    return done.returncode, done.stdout.splitlines(), done.stderr.splitlines()


def test_a_step_is_told_before_it_runs_and_its_output_is_kept(tmp_path: Path) -> None:
    status, out, errors = run(tmp_path, "step greeting '1 s' 'louder' echo hello; finish")
    assert (status, errors) == (0, [])
    assert out == ["greeting: usually 1 s; log: runs/log/greeting.log", "hello"]
    assert (tmp_path / "runs/log/greeting.log").read_text() == "hello\n"


def test_the_last_lines_tell_every_failure(tmp_path: Path) -> None:
    first = "printf 'FAILED a::b - wrong\\nmore words\\n'; return 3"
    script = f"first() {{ {first}; }}; step one '1 s' 'this' first; step two '1 s' 'that' false"
    status, out, errors = run(tmp_path, f"{script}; finish")
    assert status == 1
    assert "two: usually 1 s; log: runs/log/two.log" in out
    assert errors == [
        *("error: one failed:", "  FAILED a::b - wrong", "try: this", "log: runs/log/one.log"),
        *("error: two failed:", "", "try: that", "log: runs/log/two.log"),
    ]


def test_a_heartbeat_tells_what_is_done_and_what_runs() -> None:
    class Report:
        nodeid = "tests/unit/test_fast.py::test_a"
        failed = True
        when = "teardown"

    heartbeat = Heartbeat()
    heartbeat.pytest_runtest_logstart(Report.nodeid)
    heartbeat.pytest_runtest_logstart("tests/unit/test_slow.py::test_b[x/y]")
    heartbeat.pytest_runtest_logreport(Report)
    assert heartbeat.line(7) == "0:00 min: 1 of 7 tests done, 1 failed; now test_slow.py"
