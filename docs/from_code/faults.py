"""The table of driver faults for the page on troubleshooting, as the driver defines them."""

from crane_driver import FaultKind

HEADING = "| constant | fault | before `~/reset_fault` |\n|---|---|---|\n"


def pages() -> dict[str, str]:
    """The table that the page includes."""
    rows = (f"| `FAULT_{kind.name}` | {kind.cause} | {kind.remedy} |\n" for kind in FaultKind)
    return {"faults.txt": HEADING + "".join(rows)}
