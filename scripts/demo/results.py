"""The demo's summary.json: the fit's own, and what only the demo knows."""

import json
from typing import Any

import bags
from laws import DYNAMIC_LAW, OUT, REPORT_LAW, Law

USES = ("train", "validate")


def parameters(law: Law) -> list[dict[str, Any]]:
    """Planted value and estimates of each parameter; `rls` is the online one, where there is."""
    planted = law.read("planted.json")
    online = bags.online_estimate(law.bag("train")) if law is REPORT_LAW else {}
    rows = []
    for fitted in law.read("summary.json")["parameters"]:
        name = fitted["name"]
        row = {
            "name": name,
            "unit": fitted["unit"],
            "planted": planted[name],
            "batch": fitted.get("value", fitted.get("batch")),
            "batch_std": fitted.get("std_dev", fitted.get("batch_std")),
        }
        if name in online:
            row["rls"], row["rls_std"] = online[name]
        rows.append(row)
    return rows


def write_summary(seconds: dict[str, float]) -> None:
    """Add planted values, online estimates, what was recorded, and wall times."""
    folders = {use: REPORT_LAW.bag(use) for use in USES}
    summary = REPORT_LAW.read("summary.json") | {
        "parameters": parameters(REPORT_LAW),
        "tracking_rms": bags.tracking_rms(folders["train"]),
        "bag_messages": {use: bags.messages(folder) for use, folder in folders.items()},
        "bag_gaps": {use: bags.gaps(folder) for use, folder in folders.items()},
        "dynamic_friction": DYNAMIC_LAW.read("summary.json")
        | {"parameters": parameters(DYNAMIC_LAW)},
        "wall_seconds": seconds,
    }
    text = json.dumps(summary, indent=2, ensure_ascii=False)
    (OUT / "summary.json").write_text(text + "\n", encoding="utf-8")
