"""Fill the tables of docs/robustness.md and docs/perception.md from the records of their runs.

Run: python docs/generate/tables.py

The records are docs/robustness/SCENE.json and docs/perception/several-touches-SCENE.json, which the commands wrote. A
test checks that the pages hold what this writes.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

DOCS = Path(__file__).parent.parent
SHIFTED = ("gel", "coarse", "paper", "hard", "many")
TOUCHED = ("paper", "coarse", "gel", "hard", "many")
_PROMISED = 0.93  # accuracy of stops below which a number is bold


def robustness(page: str) -> str:
    """The page with its table of every scene."""
    for scene in SHIFTED:
        conditions = json.loads((DOCS / "robustness" / f"{scene}.json").read_text())["conditions"]
        rows = [_condition(name, found["models"]) for name, found in conditions.items()]
        page = _with_rows(page, f"### `{scene}`", rows)
    return page


def perception(page: str) -> str:
    """The page with its table of several touches of one body."""
    rows = []
    for scene in TOUCHED:
        record = json.loads((DOCS / "perception" / f"several-touches-{scene}.json").read_text())
        independent, joint = (entry["results"] for entry in record["entries"])
        for number, (one, other) in enumerate(zip(independent, joint, strict=True)):
            scene_cell = "" if number else f"`{scene}`, " + f"{record['objects']:,}".replace(",", " ")
            rows.append(f"| {scene_cell} | {one['touches']} | {_touched(one)} | {_touched(other)} |")
    return _with_rows(page, "## Several touches of one body", rows)


PAGES = {"robustness.md": robustness, "perception.md": perception}


def _condition(name: str, models: Mapping[str, Any]) -> str:
    joint, independent = models["rigid body"], models["independent"]
    searches, unsure = joint["searches"], joint["searches"]["abstaining"]
    when = f", in search {unsure['searches_to_alarm']:g}" if unsure["alarms"] else ""
    cells = (
        name,
        *(f"{model['stops']['stated']:.3f}, {_kept(model['stops']['achieved'])}" for model in (joint, independent)),
        f"{searches['success']:.3f}, {independent['searches']['success']:.3f}",
        *("{:.3f} [{:.3f}, {:.3f}]".format(*found["wrong"]) for found in (searches, unsure)),
        f"{unsure['unsure'][0]:.3f}",
        f"{unsure['alarms']}{when}",
    )
    return f"| {' | '.join(cells)} |"


def _kept(achieved: float) -> str:
    return f"{achieved:.3f}" if achieved >= _PROMISED else f"**{achieved:.3f}**"


def _touched(found: Mapping[str, Any]) -> str:
    (low, high), gap = found["accuracy_interval"], found["stated"] - found["accuracy"]
    return f"{found['accuracy']:.3f} [{low:.3f}, {high:.3f}], {found['nll']:.4f}, {gap:+.3f}"


def _with_rows(page: str, heading: str, rows: list[str]) -> str:
    """The page with other rows in the first table below a heading."""
    line = page.index("|---", page.index(heading + "\n" if f"{heading}\n" in page else heading))
    first = page.index("\n", line) + 1
    return page[:first] + "\n".join(rows) + page[page.index("\n\n", first) :]


def main() -> None:
    """Write the pages."""
    for name, filled in PAGES.items():
        (DOCS / name).write_text(filled((DOCS / name).read_text()))


if __name__ == "__main__":
    main()
