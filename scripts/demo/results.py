"""The demo's summary.json: the fit's own, and what only the demo knows."""

import json
import math
from typing import Any

import bags
from laws import OUT, Law


def parameters(law: Law, online: dict[str, tuple[float, float]]) -> list[dict[str, Any]]:
    """Planted value and estimates of each parameter; `rls` is the online one, where there is."""
    planted = law.read("planted.json")
    rows = []
    for fitted in law.read("summary.json")["parameters"]:
        name = fitted["name"]
        row = {
            "name": name,
            "unit": fitted["unit"],
            "planted": planted[name],
            "batch": fitted["value"],
            "batch_std": fitted["std_dev"],
        }
        if name in online:  # JSON knows no infinity: None is what the data did not determine
            value, std_dev = online[name]
            known = math.isfinite(value) and math.isfinite(std_dev)
            row["rls"], row["rls_std"] = (value, std_dev) if known else (None, None)
        rows.append(row)
    return rows


def write_summary(law: Law, dynamic_law: Law) -> None:
    """Add planted values, online estimates, and what was recorded."""
    train, validate = law.bag("train"), law.bag("validate")
    summary = law.read("summary.json") | {
        "parameters": parameters(law, bags.online_estimate(train)),
        "tracking_rms": law.read(law.result("train").name)["rms_tracking_error"],
        "bag_messages": bags.messages(train),
        "bag_gaps": bags.gaps(train),
        "validation_bag_messages": bags.messages(validate),
        "validation_bag_gaps": bags.gaps(validate),
        "dynamic_friction": dynamic_law.read("summary.json")
        | {"parameters": parameters(dynamic_law, {})},
    }
    _write(summary)


def complete_summary(
    law: Law,
    followed: dict[str, Any] | None,
    missing_effect: dict[str, Any],
    seconds: dict[str, float],
) -> None:
    """Add how well the model led the crane, what the last act hid and found, and wall times."""
    rest = {"following": followed, "missing_effect": missing_effect, "wall_seconds": seconds}
    _write(law.read("summary.json") | rest)


def _write(summary: dict[str, Any]) -> None:
    text = json.dumps(summary, indent=2, ensure_ascii=False)
    (OUT / "summary.json").write_text(text + "\n", encoding="utf-8")
