"""``activetouch export``: write the figures and tables of a comparison."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from belief.files import require_writable, write_text
from experiments.command_line.arguments import BadArgument
from experiments.search.comparison import Comparison
from experiments.search.verdict import comparison_tables


@dataclass(frozen=True, kw_only=True)
class Export:
    """Write the figures and LaTeX tables of a comparison for a paper.

    For example:

        activetouch export --folder runs/compare-coarse --out paper --style thesis.mplstyle
    """

    folder: Path
    """Folder of a finished comparison, whose figures and tables are written."""
    format: Literal["pdf", "svg", "png", "eps"] = "pdf"
    """Format of the figures."""
    style: str | None = None
    """Style of the figures: a file of matplotlib (.mplstyle), or the name of one of its styles."""
    trust: bool = False
    """Run code of your own that the folder names, such as a scene module:attribute."""
    out: Path
    """Folder of figures and tables."""

    def run(self) -> None:
        """Write the files."""
        comparison = Comparison.load(self.folder, trust=self.trust)
        for path in write_figures(comparison, self.out, self.format, self.style):
            print(f"wrote {path}")


def write_figures(comparison: Comparison, folder: Path, kind: str = "pdf", style: str | None = None) -> list[Path]:
    """Write all figures, and all tables as LaTeX (booktabs); a ``style`` also sets the size of the figures."""
    import matplotlib.style
    from matplotlib import rc_params_from_file

    from experiments.report import figure
    from experiments.search.page import pictures

    require_writable(folder)
    found, own = list[Path](), matplotlib.style.library.get(style or "")
    if style is not None and own is None:
        if not Path(style).is_file():
            raise BadArgument(f"--style {style} is neither a file nor a style of matplotlib")
        own = rc_params_from_file(style, use_default_template=False)
    for picture in pictures(comparison):
        size = None if own and "figure.figsize" in own else picture.size
        found.append(folder / f"{picture.name}.{kind}")
        with figure(size, found[-1], style=style) as drawn:
            picture.panels[0](drawn.subplots())
    texts = {"table": comparison.to_latex()}
    texts |= {table.name: table.latex() for table in comparison_tables(comparison) if table.rows}
    for name, text in texts.items():
        found.append(folder / f"{name}.tex")
        write_text(found[-1], text + "\n")
    return found
