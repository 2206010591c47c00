"""Reports: sentences, tables and figures, written as one self-contained HTML page and as files beside it."""

from __future__ import annotations

import base64
import re
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from belief.files import write_text
from belief.table import Table

if TYPE_CHECKING:
    from experiments.reporting.style import Picture


written: list[Path] = []
"""Pages that this process wrote, the latest last; ``activetouch COMMAND --open`` shows it."""


@dataclass(frozen=True)
class Section:
    """A section of a report; on the page, figures are side by side above the tables.

    Attributes:
        title: heading; a section without one continues the section before it.
        sentences: paragraphs; on the page, text between backticks is code.
        folded: further paragraphs, which the page shows on request, by the line that stands for them.
        films: searches to step through, as the template ``film.html`` takes them.
    """

    title: str
    sentences: Sequence[str] = ()
    tables: Sequence[Table] = ()
    pictures: Sequence[Picture] = ()
    folded: Mapping[str, Sequence[str]] = field(default_factory=dict)
    films: Sequence[Mapping[str, Any]] = ()


@dataclass(frozen=True)
class Report:
    """What a command found: the only writer of pages, tables and figures.

    Attributes:
        sections: the first sentence of the first section is the verdict.
        folders: names of the folders of tables and figures; empty for the folder of the page.
        markdown: name of the file with all sentences and tables as Markdown; none if empty.
        files: content of further files, such as numbers as JSON, by name.
    """

    title: str
    sections: Sequence[Section]
    folders: tuple[str, str] = ("", "")
    markdown: str = ""
    files: Mapping[str, str] = field(default_factory=dict)

    def __str__(self) -> str:
        """Sentences and tables as Markdown."""
        pieces = [f"# {self.title}"]
        for section in self.sections:
            pieces += [f"## {section.title}"] * bool(section.title)
            pieces += [*section.sentences, *(table.markdown() for table in section.tables if table.rows)]
        return "\n\n".join(pieces)

    def save(self, folder: Path) -> Path:
        """Write ``report.html``, named tables as CSV and LaTeX, figures as SVG and PNG, and the further files.

        Returns:
            Path of the page.

        Raises:
            CannotWrite: The disk is full, or the folder is not writable.
        """
        tables, figures = (folder / name for name in self.folders)
        for section in self.sections:
            for table in (table for table in section.tables if table.name):
                table.write_csv(tables / f"{table.name}.csv")
                write_text(tables / f"{table.name}.tex", f"{table.latex()}\n")
            for picture in (picture for picture in section.pictures if picture.is_file):
                picture.write(figures)
        if self.markdown:
            write_text(folder / self.markdown, f"{self}\n")
        for name, content in self.files.items():
            write_text(folder / name, content)
        write_text(page := folder / "report.html", self.html())
        written.append(page)
        return page

    def html(self) -> str:
        """The page."""
        from jinja2 import Environment, PackageLoader, StrictUndefined

        loader = PackageLoader("experiments.reporting")
        environment = Environment(loader=loader, undefined=StrictUndefined, autoescape=True, trim_blocks=True)
        environment.filters |= {"data_uri": data_uri, "anchor": anchor, "with_code": with_code}
        return environment.get_template("page.html").render(title=self.title, sections=self.sections)


class Reported(ABC):
    """A result with a report, as which it prints."""

    @abstractmethod
    def report(self) -> Report:
        """Its sentences, tables and figures."""

    def save(self, folder: Path | str) -> Path:
        """Write the report into a folder, see :meth:`Report.save`; return the path of the page."""
        return self.report().save(Path(folder))

    def __str__(self) -> str:
        return str(self.report())


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


def with_code(escaped: str) -> str:
    """HTML in which text between backticks is code.

    >>> with_code("a &lt; b: `a`")
    'a &lt; b: <code>a</code>'
    """
    return re.sub(r"`([^`]*)`", r"<code>\1</code>", str(escaped))
