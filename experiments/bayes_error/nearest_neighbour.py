"""The limit of force-patch images, from the numbers they are drawn from."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from experiments.bayes_error.estimator import (
    Findings,
    Grid,
    Study,
    chunks,
    curve_cell,
    curve_heading,
    paired_difference,
    share,
    words,
)
from experiments.bayes_error.held_out import Stream
from experiments.bayes_error.press_features import (
    IN_THE_IMAGE,
    NUMBERS,
    VIEWS,
    PressNumbers,
    collect_numbers,
    read_by_neighbours,
)
from experiments.command_line.arguments import Count, Within
from experiments.parallel import run_tasks

_TOUCHES_PER_TASK = 50
_WHOLE = IN_THE_IMAGE[-1]


@dataclass(frozen=True)
class FewNumbers:
    """Neighbour readers of the numbers of a press."""

    known: Annotated[int, Within(2, 10**8)] = 20_000
    """Touches whose shapes are told."""
    choice: Count = 3_000
    """Touches to choose the number of neighbours on."""

    def measure(self, study: Study) -> Findings:
        """See :class:`experiments.bayes_error.estimator.Estimator`."""
        from experiments.bayes_error.figures import draw_convergence  # loads matplotlib

        test, readings = _collect(study, Stream.TEST, study.touches)
        choice, _ = _collect(study, Stream.CHOICE, self.choice)
        known, _ = _collect(study, Stream.KNOWN, self.known)
        classifier = study.classify(readings).argmax(axis=1) == test.shapes
        sizes = [size for part in (16, 8, 4, 2, 1) if (size := self.known // part)]
        views: dict[str, Any] = {}
        for name, columns in VIEWS.items():
            readers = [read_by_neighbours(known.first(size), choice, test, columns) for size in sizes]
            right = readers[-1].guesses == test.shapes
            views[name] = {
                **share(right),
                "in_the_image": name in IN_THE_IMAGE,
                "num_neighbours": readers[-1].num_neighbours,
                "upper": readers[-1].upper,
                "curve": [float(np.mean(reader.guesses == test.shapes)) for reader in readers],
                "upper_curve": [reader.upper for reader in readers],
                "above_classifier": paired_difference(right, classifier, study.seed),
            }
        creep = test.view(("along change", "across change")).any(axis=1)
        numbers = {
            "estimator": "few numbers",
            "sizes": sizes,
            "views": views,
            "limit": {"at_most": views[_WHOLE]["upper"]},
            "classifier": share(classifier),
            "creep_shows": share(creep),
            "median": dict(zip(NUMBERS, np.median(test.values, axis=0).tolist(), strict=True)),
        }
        draw_convergence(
            study.folder,
            sizes,
            {name: views[name]["curve"] for name in ("force alone", "force and contact point", _WHOLE)}
            | {"no reader of the image above": views[_WHOLE]["upper_curve"]},
            numbers["classifier"],
            "touches whose shapes are told",
        )
        title = "The ambiguity limit, from the numbers behind the images"
        return Findings(title, _say(study, numbers), _grids(numbers), numbers)


def _collect(study: Study, stream: Stream, count: int) -> tuple[PressNumbers, NDArray[np.uint8]]:
    tasks = [
        partial(collect_numbers, study.scene, study.seed, stream, numbers)
        for numbers in chunks(count, _TOUCHES_PER_TASK)
    ]
    parts = sorted(run_tasks(tasks, study.jobs, f"pressing, {stream.name.lower()}"), key=lambda part: part[0])
    shapes, values = (np.concatenate(column) for column in list(zip(*parts, strict=True))[1:3])
    readings = [reading for part in parts for reading in part[3]]
    return PressNumbers(shapes, values), np.stack(readings) if readings else np.empty(0, np.uint8)


def _say(study: Study, numbers: dict[str, Any]) -> list[str]:
    whole, depth = numbers["views"][_WHOLE], numbers["views"]["force and depth (depth is not in the image)"]
    return [
        "Why this estimator: a force-patch image is drawn from the size of the force and the contact point in one "
        "short window, and from nothing else, so no reader of the image beats the best reader of these numbers (the "
        "data-processing inequality).",
        f"{study.touches} fresh touches, each of another object, seed {study.seed}; {numbers['sizes'][-1]} known ones. "
        f"Neighbours read {words(whole)} from {_WHOLE}, so the best reader of these comes to at least about that; from "
        f"the error of the single nearest neighbour to at most {whole['upper']:.4f}, given enough known touches (Cover "
        "and Hart). A reader of images may fall short of it, where they hardly show a number (--learned-from says what "
        "every pixel tells). With half as many known touches the two "
        f"were {whole['curve'][-2]:.4f} and {whole['upper_curve'][-2]:.4f}: what still rises has not settled.",
        f"The classifier has {words(numbers['classifier'])} on the same touches; neighbours minus classifier "
        f"{words(whole['above_classifier'], '+')}.",
        "The contact point creeps while the object is held; that shows in the image, if only by a bit, in "
        f"{numbers['creep_shows']['value']:.1%} of touches, and is counted in those only.",
        f"Force and depth together tell more, {words(depth)}, but the depth of the imprint follows from geometry that "
        "these images do not show. The sideways force is not in them either: a disc has a size and no direction.",
    ]


def _grids(numbers: dict[str, Any]) -> list[Grid]:
    rows = [
        (
            name,
            words(view),
            f"{view['upper']:.3f}",
            str(view["num_neighbours"]),
            curve_cell(view["curve"]),
        )
        for name, view in numbers["views"].items()
    ]
    rows.append(("the classifier, from the image", words(numbers["classifier"]), "", "", ""))
    headings = ("given", "neighbours", "at most", "votes", curve_heading(numbers["sizes"]))
    return [Grid("What a touch's numbers tell", headings, rows)]
