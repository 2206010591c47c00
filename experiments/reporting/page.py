"""One self-contained HTML page of sentences, tables and figures."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from jinja2 import Environment, PackageLoader, StrictUndefined

from belief.files import write_text
from experiments.reporting.tables import Table

if TYPE_CHECKING:
    from experiments.reporting.style import Picture


@dataclass(frozen=True)
class Section:
    """A section of a page.

    Attributes:
        title: its heading.
        sentences: paragraphs below it.
        tables: shown below the figures, those that are long folded away.
        pictures: figures, side by side where there is room.
    """

    title: str
    sentences: Sequence[str] = ()
    tables: Sequence[Table] = ()
    pictures: Sequence[Picture] = ()


def write_page(
    path: Path, title: str, sections: Sequence[Section], template: str = "page.html", **values: object
) -> None:
    """Write a page, atomically; it needs no other file.

    Args:
        path: file to write.
        title: heading of the page.
        sections: its content.
        template: name of a template that extends ``page.html``.
        values: what else this template shows.

    Raises:
        CannotWrite: there is no room, or no permission.
    """
    write_text(path, environment().get_template(template).render(title=title, sections=sections, **values))


def environment() -> Environment:
    """Templates of all reports; a template that names an unknown value is an error."""
    found = Environment(
        loader=PackageLoader("experiments.reporting"), undefined=StrictUndefined, autoescape=True, trim_blocks=True
    )
    found.filters["data_uri"] = data_uri
    return found


def data_uri(content: str | bytes, kind: str) -> str:
    """Content as an address of its own, so that a page needs no other file.

    >>> data_uri("a", "text/csv")
    'data:text/csv;base64,YQ=='
    """
    raw = content.encode() if isinstance(content, str) else content
    return f"data:{kind};base64,{base64.b64encode(raw).decode()}"
