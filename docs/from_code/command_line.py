"""Every executable with its arguments, as its argparse parser has them."""

import argparse
import re
from collections.abc import Iterator
from importlib.metadata import EntryPoint, distribution
from unittest.mock import patch

PACKAGES = (
    *("crane_model", "crane_sim", "crane_trajectory", "crane_identification", "crane_driver"),
    *("crane_nodes", "crane_observer", "crane_viewer", "crane_benchmark"),
)
WRITES = re.compile(r"([*_`<>\[\]|])")  # what Markdown would take for itself


class _SeenError(Exception):
    def __init__(self, parser: argparse.ArgumentParser) -> None:
        self.parser = parser


def executables(package: str) -> dict[str, EntryPoint]:
    """What `ros2 run PACKAGE` starts, by name, without what has moved to another package."""
    found = distribution(package).entry_points.select(group="console_scripts")
    return {
        one.name: one
        for one in sorted(found, key=lambda one: one.name)
        if not one.module.endswith(".moved")
    }


def parser_of(program: EntryPoint) -> argparse.ArgumentParser:
    """The parser that `program` makes first of all; nothing else of it is run."""

    def seen(self: argparse.ArgumentParser, *_: object) -> None:
        raise _SeenError(self)

    with patch.object(argparse.ArgumentParser, "parse_args", seen):
        try:
            program.load()([])
        except _SeenError as found:
            found.parser.prog = program.name
            return found.parser
    raise RuntimeError(f"{program.name} reads no arguments")


def pages() -> dict[str, str]:
    """One page a package."""
    return {f"commands_{package}.md": _page(package) for package in PACKAGES}


def _page(package: str) -> str:
    parts = [f"# Commands of {package}"]
    for name, program in executables(package).items():
        parts.append(f"## {name}\n\n```{{program}} {name}\n```")
        parts.extend(_entry(package, parser_of(program)))
    return "\n\n".join(parts) + "\n"


def _entry(package: str, parser: argparse.ArgumentParser) -> Iterator[str]:
    usage = " ".join(parser.format_usage().removeprefix("usage: ").split())
    yield f"{_text(parser.description or '')}\n\n```text\nros2 run {package} {usage}\n```"
    for action in parser._actions:
        if isinstance(action, argparse._HelpAction | argparse._VersionAction):
            continue
        yield f":::{{option}} {_signature(action)}\n{_text(_help(parser, action))}\n:::"
    if parser.epilog and not parser.epilog.startswith("parameters:"):
        yield f"```text\n{parser.epilog.strip()}\n```"
    elif parser.epilog:
        yield f"Its [parameters](parameters.md#{parser.prog}) follow `--ros-args -p`."


def _signature(action: argparse.Action) -> str:
    if not action.option_strings:
        return str(action.metavar or action.dest)
    shown = ""
    if action.nargs != 0:
        one = action.metavar or ("VALUE" if action.choices else action.dest.upper())
        shown = f" {one} ..." if action.nargs in ("+", "*") else f" {one}"
    return ", ".join(name + shown for name in action.option_strings)


def _help(parser: argparse.ArgumentParser, action: argparse.Action) -> str:
    told = parser._get_formatter()._expand_help(action) if action.help else ""
    if action.choices and not isinstance(action.choices, range):
        told += f"; one of {', '.join(map(str, action.choices))}"
    must = action.option_strings and action.required
    return told.removeprefix("; ") + (" (must be given)" if must else "")


def _text(text: str) -> str:
    return WRITES.sub(r"\\\1", " ".join(text.split()))
