"""Every heading of the tables of a comparison is explained in the docs."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent.parent.parent
FILES = ("tables.py", "selective_tables.py", "overview.py")
HEADING = re.compile(r"""\("([^"]+)", "[+,]?\.?\d*[a-z]?"\)""")


def explained():
    text = (ROOT / "docs" / "columns.md").read_text()
    first = [line.split("|")[1] for line in text.splitlines() if line.startswith("| ")]
    return {word.strip() for cell in first for word in cell.split(",")}


@pytest.mark.parametrize("file", FILES)
def test_every_heading_is_explained(file):
    found = set(HEADING.findall((ROOT / "experiments" / "search" / file).read_text()))
    assert len(found) > 5
    assert {heading.strip() for heading in found} <= explained()
