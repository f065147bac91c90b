"""A laboratory crane's layout, and small DBC and mapping files written for one test."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from crane_driver import load_layout
from crane_driver.can.layout import Layout
from crane_model import load_machine
from crane_model.machine_files import machine_file

Signal = tuple[str, str, str]  # name, layout and scale as in SG_, unit


@pytest.fixture(scope="session")
def crane() -> Layout:
    """Layout of the laboratory crane."""
    return load_layout(load_machine(), machine_file("can.yaml"), machine_file("can.dbc"))


@pytest.fixture
def write_dbc(tmp_path: Path) -> Callable[..., Path]:
    """Write a DBC file: messages by name with id, length, cycle time [ms] and signals."""

    def write(messages: dict[str, tuple[int, int, int, list[Signal]]], tail: str = "") -> Path:
        lines = ['VERSION ""', "NS_ :", "BS_:", "BU_: Unit", ""]
        for name, (identifier, length, _, signals) in messages.items():
            lines.append(f"BO_ {identifier} {name}: {length} Unit")
            lines += [f' SG_ {one} : {how} "{unit}" Unit' for one, how, unit in signals]
            lines.append("")
        lines += ['BA_DEF_ BO_ "GenMsgCycleTime" INT 0 65535;']
        lines += ['BA_DEF_DEF_ "GenMsgCycleTime" 0;']
        for identifier, _, cycle, _ in messages.values():
            if cycle:
                lines.append(f'BA_ "GenMsgCycleTime" BO_ {identifier} {cycle};')
        path = tmp_path / "machine.dbc"
        path.write_text("\n".join([*lines, tail, ""]))
        return path

    return write


@pytest.fixture
def write_mapping(tmp_path: Path) -> Callable[[dict[str, Any]], Path]:
    """Write a mapping file."""

    def write(content: dict[str, Any]) -> Path:
        path = tmp_path / "machine.yaml"
        path.write_text(yaml.safe_dump(content, sort_keys=False))
        return path

    return write
