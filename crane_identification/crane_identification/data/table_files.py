"""Which files are tables. To read them takes polars, which is large and may not be there."""

import re
from pathlib import Path

TABLES = (".csv", ".tsv", ".txt", ".parquet", ".mat")


def tables_in(folder: Path) -> list[Path]:
    """The tables of a folder, in the order of their names, where numbers count as numbers."""
    if not folder.is_dir():
        return []
    tables = [path for path in folder.iterdir() if path.suffix.lower() in TABLES]
    return sorted(tables, key=lambda path: _natural(path.name))


def _natural(name: str) -> list[tuple[int, str]]:
    return [(int(one) if one.isdigit() else 0, one) for one in re.split(r"(\d+)", name)]
