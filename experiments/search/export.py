"""``activetouch export``: write a search as a ``.pomdp`` file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from belief.composition import Composition
from belief.errors import InvalidArgument, UnknownName
from belief.files import write_text
from experiments.command_line.arguments import Count, NotNegative, Within, check_arguments
from experiments.scene_choice import SceneChoice
from experiments.search.setting import Setting
from planners.export import to_pomdp
from planners.solve import SearchTouchProblem


@dataclass(frozen=True, kw_only=True)
class Export:
    """Write the search of a scene as a .pomdp file, for other solvers.

    For example:

        activetouch export --scene coarse --target cone --out cone.pomdp
        activetouch export --scene coarse --target cone --discount 0.999 --out for-sarsop.pomdp
        activetouch export --scene many --target cone --num-objects 1 --out one-object.pomdp
    """

    target: str
    """Shape to search for."""
    out: Path
    """File to write."""
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
        """Write the file.

        Raises:
            BadArgument: An argument is invalid.
            UnknownName: The scene has no such shape.
            InvalidArgument: The search is too large; use fewer objects.
        """
        check_arguments(self)
        setting = Setting(
            SceneChoice(self.scene), sensor=self.sensor, num_objects=self.num_objects, touch_cost=self.touch_cost
        )
        problem = setting.problem
        if self.target not in problem.shape_labels:
            raise UnknownName("target", self.target, list(problem.shape_labels))
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
