"""``activetouch export``: write a search as a ``.pomdp`` file."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from belief import Composition
from belief.errors import InvalidArgument, UnknownName
from belief.files import write_text
from experiments.command_line.arguments import BadArgument, Within, check_arguments
from experiments.search.setting import Setting, known_model, require_abstain
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
    setting: Annotated[Setting, tyro.conf.arg(name="")] = field(default_factory=Setting)
    """Setting of the search."""

    def run(self) -> None:
        """Write the file.

        Raises:
            BadArgument: An argument is invalid.
            UnknownName: The scene has no such shape.
            InvalidArgument: The search is too large; use fewer objects.
        """
        check_arguments(self)
        if self.setting.abstain is not None:
            raise BadArgument("--abstain is for compare; export writes a search without the answer UNSURE")
        require_abstain(self.setting)
        problem = self.setting.problem
        if self.target not in problem.shape_labels:
            raise UnknownName("target", self.target, list(problem.shape_labels))
        target = problem.shape_labels.index(self.target)
        table = known_model(self.setting)[1]
        if not isinstance(problem.composition, Composition):
            raise InvalidArgument("a .pomdp file needs --composition distinct or independent; or --num-objects 1")
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
