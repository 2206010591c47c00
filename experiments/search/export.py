"""``activetouch export``: write the figures and tables of a comparison, or a search as a ``.pomdp`` file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from belief.composition import Composition
from belief.errors import InvalidArgument, UnknownName
from belief.files import require_writable, write_text
from experiments.command_line.arguments import BadArgument, Count, NotNegative, Within, check_arguments
from experiments.scene_choice import SceneChoice
from experiments.search.comparison import Comparison
from experiments.search.setting import Setting
from experiments.search.tables import comparison_tables
from planners.export import to_pomdp
from planners.solve import SearchTouchProblem


@dataclass(frozen=True, kw_only=True)
class Export:
    """Write the figures and LaTeX tables of a comparison for a paper, or the search of a scene as a .pomdp file.

    For example:

        activetouch export --folder runs/compare-coarse --out paper --style thesis.mplstyle
        activetouch export --scene coarse --target cone --out cone.pomdp
        activetouch export --scene coarse --target cone --discount 0.999 --out for-sarsop.pomdp
        activetouch export --scene many --target cone --num-objects 1 --out one-object.pomdp
    """

    folder: Path | None = None
    """Folder of a finished comparison, whose figures and tables are written."""
    format: Literal["pdf", "svg", "png", "eps"] = "pdf"
    """Format of the figures."""
    style: str | None = None
    """Style of the figures: a file of matplotlib (.mplstyle), or the name of one of its styles."""
    trust: bool = False
    """Run code of your own that the folder names, such as a scene module:attribute."""
    target: str | None = None
    """Shape to search for; writes a .pomdp file."""
    out: Path
    """Folder of figures and tables, or .pomdp file to write."""
    discount: Annotated[float, Within(0.0, 1.0, open_low=True)] = 1.0
    """Discount for each touch and each rejection. Searches have 1; SARSOP and others need less, such
    as 0.999."""
    scene: str = "gel"
    """Scene of the search."""
    sensor: Path | None = None
    """Folder of a sensor, or name of a shipped one; that of the scene by default."""
    num_objects: Count | None = None
    """Objects in a search; that of the scene by default."""
    touch_cost: NotNegative = 0.02
    """Cost λ of one touch, in units of a success."""

    def run(self) -> None:
        """Write the files.

        Raises:
            BadArgument: An argument is invalid, or both or none of ``folder`` and ``target`` are given.
            UnknownName: The scene has no such shape.
            InvalidArgument: The search is too large; use fewer objects.
        """
        check_arguments(self)
        if (self.folder is None) == (self.target is None):
            raise BadArgument("give --folder RUN for the figures of a comparison, or --target SHAPE for a .pomdp file")
        if self.folder is not None:
            comparison = Comparison.load(self.folder, trust=self.trust)
            for path in write_figures(comparison, self.out, self.format, self.style):
                print(f"wrote {path}")
        else:
            self._write_pomdp()

    def _write_pomdp(self) -> None:
        setting = Setting(
            SceneChoice(self.scene), sensor=self.sensor, num_objects=self.num_objects, touch_cost=self.touch_cost
        )
        problem = setting.problem
        if self.target is None or self.target not in problem.shape_labels:
            raise UnknownName("target", str(self.target), list(problem.shape_labels))
        target = problem.shape_labels.index(self.target)
        table = setting.open_sensor().model.outcome_table()
        if not isinstance(problem.composition, Composition):
            raise InvalidArgument("a .pomdp file needs objects that are distinct or independent; or --num-objects 1")
        try:
            search = SearchTouchProblem(
                table.probs,
                problem.num_objects,
                problem.composition,
                target,
                problem.touch_cost,
                discount=self.discount,
            )
            text = to_pomdp(search, problem.shape_labels, problem.pose_labels)
        except InvalidArgument as error:
            raise InvalidArgument(f"{error}. For one object: --num-objects 1") from error
        write_text(self.out, text)
        print(f"{self.out}: search for the {self.target} among {problem.num_objects} objects")
        if self.discount == 1.0:
            print("discount 1: SARSOP and other solvers refuse it; --discount 0.999 writes a file for them")


def write_figures(comparison: Comparison, folder: Path, kind: str = "pdf", style: str | None = None) -> list[Path]:
    """Write every figure of a comparison, and every table as LaTeX (booktabs).

    Args:
        comparison: a comparison that was played, or was read by :meth:`Comparison.load`.
        folder: folder to write.
        kind: ending of the figures, such as ``pdf``.
        style: matplotlib style, by name or file; its ``figure.figsize`` also sets the size of the figures.

    Returns:
        Paths of the files.

    Raises:
        BadArgument: There is no such style.
        CannotWrite: The disk is full, or the folder is not writable.
    """
    import matplotlib.style
    from matplotlib import rc_params_from_file

    from experiments.reporting.style import figure
    from experiments.search.figures import pictures

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
