"""The manual: README and the pages under docs."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGES = sorted(
    path.relative_to(ROOT).as_posix()
    for pattern in ("*.md", "docs/*.md", "docs/*/*.md")
    for path in ROOT.glob(pattern)
)


def text(page: str) -> str:
    """What stands in a `page`, named from the top of the repository."""
    return (ROOT / page).read_text("utf-8")
