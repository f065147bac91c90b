"""Every row of the safety tables has a test, and every test that the page names is there."""

import re

from manual import ROOT, text

PAGE = text("docs/explanation/safety.md")
SHOWN = text("docs/developers/safety_tests.md")
ROW = re.compile(r"^\| (\d+) \|", re.MULTILINE)
TEST = re.compile(r"^ *(\d+(?:, \d+)*)  (test_\w+)$", re.MULTILINE)
FILE = re.compile(r"^(test_\w+\.py)$", re.MULTILINE)


def test_every_row_has_a_test_that_exists() -> None:
    parts = FILE.split(SHOWN)[1:]
    proven: set[str] = set()
    for name, listed in zip(parts[::2], parts[1::2], strict=True):
        source = "".join(file.read_text("utf-8") for file in (ROOT / "tests").rglob(name))
        found = TEST.findall(listed)
        assert found, name
        for rows, test in found:
            assert f"def {test}(" in source, f"{name}: {test}"
            proven |= set(rows.split(", "))
    rows = ROW.findall(PAGE)
    assert rows == [str(number) for number in range(1, len(rows) + 1)]
    assert set(rows) == proven
