"""Pages as Jupyter notebooks, in ``examples/notebooks``, from which Colab opens them.

Run: python docs/generate/notebooks.py        (after a change of one of these pages)
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from posixpath import normpath
from typing import Any

ROOT = Path(__file__).parent.parent.parent
FOLDER = ROOT / "examples/notebooks"
NOTEBOOKS = ("toy", "your_classifier", "any_decision", "adaptive_test", "diagnosis", "digits")
"""Pages that are notebooks, too; their code is tested as it stands on the page."""
REPOSITORY = "https://github.com/activetouch/activetouch/blob/main"
COLAB = "https://colab.research.google.com/github/activetouch/activetouch/blob/main/examples/notebooks"
LINK = re.compile(r"(!?)\[((?:[^\[\]]|\[[^\]]*\])*)\]\(([^)\s#]*)(#[^)\s]*)?\)")
INSTALL = """import sys

if "google.colab" in sys.modules:  # elsewhere it is installed
    %pip install -q "git+https://github.com/activetouch/activetouch"
"""
"""The first cell."""


def notebook(page: Path) -> str:
    """The page as a Jupyter notebook: its Python blocks are cells of code, what is between them is text.

    The first cell of code installs the package in Colab.
    """
    cells: list[dict[str, Any]] = []
    for number, part in enumerate(
        re.split(r"^```python\n(.*?)^```\n", page.read_text(encoding="utf-8"), flags=re.S | re.M)
    ):
        cell: dict[str, Any] = {"id": f"cell-{number}", "metadata": {}, "source": part.strip()}
        if number % 2:
            cells.append(cell | {"cell_type": "code", "execution_count": None, "outputs": []})
        elif part.strip():
            linked = LINK.sub(lambda link: link[0].replace(f"]({link[3]}", f"]({_online(link[3])}"), part.strip())
            cells.append(cell | {"cell_type": "markdown", "source": linked})
    install = {"id": "install", "metadata": {}, "source": INSTALL.strip()}
    cells.insert(1, install | {"cell_type": "code", "execution_count": None, "outputs": []})
    kernel = {"kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"}}
    return json.dumps({"cells": cells, "metadata": kernel, "nbformat": 4, "nbformat_minor": 5}, indent=1)


def _online(target: str) -> str:
    """Where a link of a page in docs/ leads from anywhere."""
    return target if not target or "://" in target else f"{REPOSITORY}/{normpath(f'docs/{target}')}"


def main() -> None:
    """Write all notebooks."""
    FOLDER.mkdir(exist_ok=True)
    for name in NOTEBOOKS:
        (FOLDER / f"{name}.ipynb").write_text(f"{notebook(ROOT / f'docs/{name}.md')}\n", encoding="utf-8", newline="\n")


if __name__ == "__main__":
    main()
