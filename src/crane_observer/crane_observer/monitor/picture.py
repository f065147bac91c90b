"""A picture of the residuals that the sensor monitor computed from a recording."""

from pathlib import Path

from matplotlib.figure import Figure

from crane_observer.monitor.replay import WatchedBag


def draw(seen: WatchedBag, file: Path) -> None:
    """The share of its tolerance that each chamber takes over time, and the findings."""
    figure = Figure(figsize=(9.0, 1.6 * (len(seen.joints) + 1)), layout="constrained")
    panels = figure.subplots(len(seen.joints) + 1, 1, sharex=True)
    for j, joint in enumerate(seen.joints):
        for side, name in enumerate("AB"):
            panels[j].plot(
                seen.sums.time, seen.taken[:, 2 * j + side], lw=0.8, label=f"against chamber {name}"
            )
        panels[j].set_ylabel(joint)
    panels[-1].plot(seen.sums.time, seen.taken[:, -1], lw=0.8, color="C2")
    panels[-1].set_ylabel("supply")
    panels[-1].set_xlabel("time [s]")
    for panel in panels:
        panel.axhline(1.0, color="black", lw=0.6, ls="--")
        panel.set_yscale("log")
        panel.set_ylim(0.02, 50.0)
        for one in seen.findings:
            panel.axvline(one.onset, color="red", lw=0.8)
    panels[0].legend(loc="upper left", fontsize="small", ncols=2)
    told = "; ".join(f"{one.sensor}: {one.kind} {one.how_much}" for one in seen.findings)
    panels[0].set_title(f"{seen.bag.name}: share of the tolerance taken. {told or 'Nothing found'}",
                        fontsize="medium")  # fmt: skip
    figure.savefig(file, dpi=120)
