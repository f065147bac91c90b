"""Messages and actions, with the comments of their files, which state units."""

from pathlib import Path

INTERFACES = Path(__file__).resolve().parents[2] / "crane_interfaces"
INTRODUCTION = """# Messages and actions

Of the package `crane_interfaces`. Every field states its unit.
"""


def pages() -> dict[str, str]:
    """All of them on one page."""
    files = sorted(
        path for path in INTERFACES.glob("*/*.*") if path.suffix in (".msg", ".srv", ".action")
    )
    return {"messages.md": "\n".join([INTRODUCTION, *map(_entry, files)])}


def _entry(path: Path) -> str:
    """The comment at the head of the file as text, the rest as it stands."""
    lines = path.read_text("utf-8").splitlines()
    end = next(i for i, line in enumerate(lines) if not line.startswith("#"))
    about = "\n".join(line.removeprefix("#").removeprefix(" ") for line in lines[:end])
    about = about.replace("\n- ", "\n\n- ", 1)
    about = about.replace("HAZARD:", "**Hazard:**")
    kind = path.suffix.removeprefix(".")
    body = "\n".join(lines[end:]).strip("\n")
    name = f"crane_interfaces/{kind}/{path.stem}"
    return f"## {path.stem}\n\n`{name}`\n\n{about}\n\n```text\n{body}\n```\n"
