import os
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="session")
def real_data() -> Path:
    """Folder of measured data from real machines: CRANE_REAL_DATA, or ../shared/data."""
    folder = Path(os.environ.get("CRANE_REAL_DATA", ROOT.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"no real data in {folder}; set CRANE_REAL_DATA to the folder that holds it")
    return folder
