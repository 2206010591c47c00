"""Draw the figures of the trade-off and of the paper's searches again, from the numbers that records/ holds.

Run: python docs/generate/figures.py
"""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from experiments.paper.figures import draw_figure3
from experiments.paper.table2 import Column
from experiments.tradeoff.figures import front_picture
from experiments.tradeoff.measure import TASKS, Front

DOCS = Path(__file__).parent.parent
RECORDS = DOCS.parent / "records"


def point(stored: dict[str, Any]) -> Any:
    """What the figure of the trade-off reads of a configuration's results."""
    told = stored["configuration"]
    number = told["num_hypotheses"] or (-told["touch_cost"] if stored["varied"] == "touch cost λ" else None)
    configuration = SimpleNamespace(
        scene=told["network"]["scene"], varied=stored["varied"], decider=told["decider"], number=number
    )
    names = ("ms_per_search", "success", "interval")
    return SimpleNamespace(configuration=configuration, **{name: stored[name] for name in names})


def main() -> None:
    """Write docs/tradeoff/tradeoff.svg and docs/reproduction/figure3.svg."""
    points = [point(stored) for stored in _record("tradeoff/tradeoff")["points"]]
    fronts = [
        Front(task, [one for one in points if one.configuration.scene in scenes], np.empty(0))
        for task, scenes in TASKS.items()
    ]
    front_picture(fronts).write(DOCS / "tradeoff")
    (DOCS / "tradeoff" / "tradeoff.png").unlink()
    confusion = _record("reproduction/table1")["splits"]["by image"]["held out"]["confusion"]
    columns = [Column(**stored) for stored in _record("reproduction/table2")]
    draw_figure3(confusion, columns, DOCS / "reproduction" / "figure3.svg")


def _record(name: str) -> Any:
    return json.loads((RECORDS / f"{name}.json").read_text())


if __name__ == "__main__":
    main()
