"""Self-contained HTML pages of sentences, tables and figures."""

from __future__ import annotations

import base64
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from jinja2 import Environment, PackageLoader, StrictUndefined

from belief.files import write_text
from belief.table import Table

if TYPE_CHECKING:
    from experiments.reporting.style import Picture


written: list[Path] = []
"""Pages that this process wrote, the latest last; ``activetouch COMMAND --open`` shows it."""


@dataclass(frozen=True)
class Section:
    """A section of a page; tables are below the figures, which are side by side on a wide page."""

    title: str
    sentences: Sequence[str] = ()
    tables: Sequence[Table] = ()
    pictures: Sequence[Picture] = ()


def write_page(
    path: Path, title: str, sections: Sequence[Section], template: str = "page.html", **values: object
) -> None:
    """Write a page, atomically, with a template that extends ``page.html`` and its further values."""
    environment = Environment(
        loader=PackageLoader("experiments.reporting"), undefined=StrictUndefined, autoescape=True, trim_blocks=True
    )
    environment.filters |= {"data_uri": data_uri, "anchor": anchor}
    write_text(path, environment.get_template(template).render(title=title, sections=sections, **values))
    written.append(path)


def anchor(title: str) -> str:
    """The anchor of a heading.

    >>> anchor("Answers and “I do not know”")
    'answers-and-i-do-not-know'
    """
    return re.sub(r"[^\w]+", "-", title.lower()).strip("-")


def data_uri(content: str | bytes, kind: str) -> str:
    """Content as a ``data:`` URI.

    >>> data_uri("a", "text/csv")
    'data:text/csv;base64,YQ=='
    """
    raw = content.encode() if isinstance(content, str) else content
    return f"data:{kind};base64,{base64.b64encode(raw).decode()}"
