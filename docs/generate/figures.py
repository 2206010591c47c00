"""Draw the figures of the trade-off, of the paper's searches and of changed worlds, from what records/ holds.

Run: python docs/generate/figures.py
"""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import matplotlib.style
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from tables import DRAWN, health_of, read_record

from experiments.paper.table2 import Column, figure3
from experiments.tradeoff.report import front_picture

DOCS = Path(__file__).parent.parent
THEMES = {
    "drift": ("#ffffff", "#1f2328", "#8c959f", "#c0540a", "#1a7f5a"),
    "drift_dark": ("#0d1117", "#e6edf3", "#6e7681", "#f0883e", "#3fb98f"),
}
"""Name of a file: colours of the paper, of text, of what is stated, and of what is right before and now."""


def point(stored: dict[str, Any]) -> Any:
    """What the figure of the trade-off reads of a configuration's results."""
    told = stored["configuration"]
    own = {name: told[name] for name in ("scene", "decider")} | {name: stored[name] for name in ("varied", "number")}
    names = ("ms_per_search", "success", "interval")
    return SimpleNamespace(configuration=SimpleNamespace(**own), **{name: stored[name] for name in names})


def main() -> None:
    """Write docs/tradeoff/tradeoff.svg, docs/reproduction/figure3.svg, and docs/robustness/drift.svg, also dark."""
    points = [point(stored) for stored in read_record("tradeoff/searches_0")["points"]]
    confusion = read_record("reproduction/table1")["splits"]["by image"]["held out"]["confusion"]
    columns = [
        Column(**{name: value for name, value in stored.items() if name != "oracle"})
        for stored in read_record("reproduction/table2")
    ]
    pictures = {"tradeoff": front_picture(points), "reproduction": figure3(confusion, columns)}
    for folder, picture in pictures.items():
        picture.write(DOCS / folder)
        (DOCS / folder / f"{picture.name}.png").unlink()
    for name, colours in THEMES.items():
        draw_drift(DOCS / "robustness" / f"{name}.svg", *colours)


def draw_drift(path: Path, paper: str, ink: str, faint: str, bad: str, good: str) -> None:
    """What is stated at stops, and what is right, as worlds drift away from that of the sensor: before and now."""
    names = ("text.color", "axes.edgecolor", "axes.labelcolor", "xtick.color", "ytick.color")
    own: Any = {"font.size": 9, "svg.fonttype": "none", "svg.hashsalt": path.stem} | dict.fromkeys(names, ink)
    with matplotlib.style.context(["default", own]):
        drawn = Figure((9.2, 4.9), layout="constrained", facecolor=paper)
        for axes, scene in zip(drawn.subplots(1, 2, sharey=True), ("coarse", "gel"), strict=True):
            axes.set_facecolor(paper)
            for row, world in enumerate(DRAWN):
                own, unknown = (health_of(scene, world, sensor) for sensor in ("own", "unknown"))
                if own is None or unknown is None:
                    continue
                axes.plot([float(own["right"]), float(own["stated"])], [row, row], color=faint, linewidth=1, zorder=1)
                axes.plot(float(own["stated"]), row, "|", color=ink, markersize=11, markeredgewidth=2)
                axes.plot(float(own["right"]), row, "o", color=bad)
                is_heard = 2 * int(unknown["alarms"]) >= int(unknown["sessions"])
                face = paper if is_heard else good
                axes.plot(float(unknown["right"]), row, "D", color=good, markerfacecolor=face, markersize=5.5)
            axes.axvline(0.95, color=faint, linewidth=0.8, linestyle=":")
            axes.set(xlim=(0.15, 1.03), xlabel="right at stops", title=scene)
            axes.spines[["top", "right"]].set_visible(False)
        axes.set_yticks(range(len(DRAWN)), [world.replace("usual", "as described") for world in DRAWN])
        axes.invert_yaxis()
        marks = [("|", ink, ink), ("o", bad, bad), ("D", good, good), ("D", good, paper)]
        handles = [
            Line2D([], [], linestyle="", marker=mark, color=colour, markerfacecolor=face)
            for mark, colour, face in marks
        ]
        labels = (
            "stated",
            "right before: own reader",
            "right now: unknown state",
            "the same, with an alarm in most sessions",
        )
        drawn.legend(handles, labels, loc="outside upper center", ncols=4, frameon=False)
        path.parent.mkdir(exist_ok=True)
        drawn.savefig(path, facecolor=paper, metadata={"Date": None})


if __name__ == "__main__":
    main()
