"""Every heading of the tables of a comparison is explained in the docs."""

import re
from pathlib import Path

ROOT = Path(__file__).parent.parent.parent.parent
HEADING = re.compile(r"""\("([^"]+)", "[+,]?\.?\d*[a-z]?"\)""")


def explained():
    text = (ROOT / "docs" / "columns.md").read_text()
    first = [line.split("|")[1] for line in text.splitlines() if line.startswith("| ")]
    return {word.strip() for cell in first for word in cell.split(",")}


def test_every_heading_is_explained():
    found = set(HEADING.findall((ROOT / "experiments" / "search" / "verdict.py").read_text()))
    assert len(found) > 5
    assert {heading.strip() for heading in found} <= explained()
