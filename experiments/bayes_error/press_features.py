"""The best reader of force-patch images: a reader of the few numbers they are drawn from.

A force-patch image (paper §5.5) is a function of the size of the force and of the contact point, in the readings of one
short window. No reader of a function of some numbers beats the best reader of the numbers themselves (the
data-processing inequality), so the limit is looked for among the latter. Four steps make them few:

* turned and mirrored presses are as likely, so a contact point is folded into the eighth of the square pad in which
  ``0 ≤ across ≤ along``;
* within the window, while the object is held, little changes, and smoothly: the mean, the change from first to last,
  and the bend between them will do;
* the contact point creeps by nanometres. Where an image drawn with its mean instead is the same to the bit, the creep
  is not in the image, and is taken for zero: the image is still a function of what is kept;
* every number is replaced by its rank, so that no unit matters.

The best reader is approached by the votes of nearest neighbours. A vote's accuracy is at most the limit. The single
nearest neighbour bounds it from the other side: given enough known touches its error e and the least possible error e*
satisfy e ≤ e* (2 - e* K / (K - 1)) (Cover and Hart 1967).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from activetouch.pressing.contact import Contact
from activetouch.pressing.trace import Trace
from activetouch.rendering import ForcePatchRenderer
from activetouch.scene import Scene
from experiments.bayes_error.held_out import Stream, fresh_touch

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

NEIGHBOURS = (1, 3, 5, 9, 15, 25, 51, 101)
"""How many may vote."""

NUMBERS = (
    "force",
    "along",
    "across",
    "force change",
    "force bend",
    "along change",
    "across change",
    "sideways force",
    "depth",
)
"""What is kept of a press [N, m]; the contact point folded, changes within the window. The last two no image shows."""

VIEWS: Mapping[str, tuple[str, ...]] = {
    "force alone": ("force",),
    "distance of the contact point from the pad's centre alone": ("radius",),
    "contact point": ("along", "across"),
    "force and distance": ("force", "radius"),
    "force and contact point": ("force", "along", "across"),
    "force, contact point, change of the force": ("force", "along", "across", "force change"),
    "force, contact point, course of the force": NUMBERS[:5],
    "force, contact point, course of both": NUMBERS[:7],
    "the same and the sideways force (not in the image)": NUMBERS[:8],
    "force and depth (depth is not in the image)": ("force", "depth"),
    "force, contact point, and depth (depth is not in the image)": ("force", "along", "across", "depth"),
}
"""What a reader may be given; ``radius`` is the length of (along, across)."""

IN_THE_IMAGE = tuple(name for name, columns in VIEWS.items() if not {"depth", "sideways force"} & set(columns))
"""The views made of what an image is drawn from; whether it shows them is another question."""


@dataclass(frozen=True, eq=False)
class PressNumbers:
    """Numbers of some touches.

    Attributes:
        shapes: of the touched objects, ``(n,)``.
        values: columns as :data:`NUMBERS`, ``(n, 9)``.
    """

    shapes: Ints
    values: Floats

    def view(self, columns: Sequence[str]) -> Floats:
        """Some of the columns, ``(n, D)``; ``radius`` is computed."""
        known = dict(zip(NUMBERS, self.values.T, strict=True))
        known["radius"] = np.hypot(known["along"], known["across"])
        return np.column_stack([known[name] for name in columns])

    def first(self, count: int) -> PressNumbers:
        """The first touches."""
        return PressNumbers(self.shapes[:count], self.values[:count])


def press_numbers(contact: Contact, renderer: ForcePatchRenderer) -> Floats:
    """The numbers of a press, as :data:`NUMBERS`; zeros where nothing was held.

    Raises:
        ValueError: the contact has no trace.
    """
    drawn = drawn_rows(contact, renderer)
    size = np.linalg.norm(drawn.force, axis=1)
    if not size.any():
        return np.array([0.0] * (len(NUMBERS) - 1) + [contact.depth])
    force, point, size = drawn.force[size > 0.0], drawn.point[size > 0.0], size[size > 0.0]
    centre = point.mean(axis=0)
    still = replace(drawn, point=np.broadcast_to(centre, drawn.point.shape))
    creep_shows = (renderer(replace(contact, trace=drawn)) != renderer(replace(contact, trace=still))).any()
    folded = point * np.where(centre < 0.0, -1.0, 1.0)
    if abs(centre[1]) > abs(centre[0]):
        folded = folded[:, ::-1]
    along, across = folded.mean(axis=0)
    bend = size[len(size) // 2] - (size[0] + size[-1]) / 2
    creep = (folded[-1] - folded[0]) * creep_shows
    sideways = np.linalg.norm(force[:, 1:], axis=1).mean()
    return np.array([size.mean(), along, across, size[-1] - size[0], bend, *creep, sideways, contact.depth])


def drawn_rows(contact: Contact, renderer: ForcePatchRenderer) -> Trace:
    """The rows of a press's trace that its image is drawn from; none where nothing was held.

    Raises:
        ValueError: the contact has no trace.
    """
    if contact.trace is None:
        raise ValueError("there is no trace to read; press with a fidelity that records one (GuardedMove)")
    end = contact.trace.end_of_pause
    time = contact.trace.time[:end]
    first = int(np.searchsorted(time, time[-1] - renderer.window, side="right")) if end else 0
    return contact.trace.select(slice(first, end))


def collect_numbers(scene: Scene, seed: int, stream: Stream, numbers: range) -> tuple[int, Ints, Floats, list]:
    """First number; shapes, numbers and readings of fresh touches. Readings only of test touches: others need none."""
    assert isinstance(scene.renderer, ForcePatchRenderer), "the caller chose this scene for its renderer"
    shapes, rows, readings = [], [], []
    for number in numbers:
        touch = fresh_touch(scene, seed, stream, number)
        shapes.append(touch.shape)
        rows.append(press_numbers(touch.contact, scene.renderer))
        if stream is Stream.TEST:
            readings.append(touch.reading)
    return numbers[0], np.array(shapes), np.array(rows), readings


def neighbour_guesses(known: Floats, known_shapes: Ints, asked: Floats, num_neighbours: Sequence[int]) -> Ints:
    """What the nearest known rows vote for, by rank in each column.

    Args:
        known: rows of touches whose shapes are told, ``(n, D)``.
        known_shapes: ``(n,)``.
        asked: other rows, ``(m, D)``.
        num_neighbours: how many vote; all these are tried, ``(V,)``.

    Returns:
        Shapes ``(V, m)``; of shapes with equally many votes that of the nearest among them.
    """
    ranks, places = _ranks(known, known), _ranks(known, asked)
    most = min(max(num_neighbours), len(known))
    _, nearest = KDTree(ranks).query(places, k=most)
    votes = np.eye(known_shapes.max() + 1)[known_shapes[nearest.reshape(len(asked), most)]]  # (m, most, K)
    # Earlier neighbours count a hair more, too little to outvote anything: that breaks ties.
    counts = np.cumsum(votes * (1.0 + 1e-6 / np.arange(1, most + 1))[:, None], axis=1)
    return np.stack([counts[:, min(k, most) - 1].argmax(axis=1) for k in num_neighbours])


def _ranks(known: Floats, asked: Floats) -> Floats:
    """Share of known values below each value, by column, ties at their middle, ``(m, D)``."""
    columns = []
    for reference, values in zip(np.sort(known, axis=0).T, asked.T, strict=True):
        below, upto = (np.searchsorted(reference, values, side) for side in ("left", "right"))
        columns.append((below + upto) / (2 * len(reference)))
    return np.stack(columns, axis=1)


@dataclass(frozen=True, eq=False)
class Reader:
    """How a neighbour reader did.

    Attributes:
        num_neighbours: that voted, chosen on separate touches.
        guesses: its shapes for the test touches, ``(m,)``.
        upper: bound on the accuracy of any reader, from the single nearest neighbour.
    """

    num_neighbours: int
    guesses: Ints
    upper: float


def read_by_neighbours(known: PressNumbers, choice: PressNumbers, test: PressNumbers, columns: Sequence[str]) -> Reader:
    """Choose the number of neighbours on ``choice``, and read ``test`` with it."""
    rows = known.view(columns)
    tried = neighbour_guesses(rows, known.shapes, choice.view(columns), NEIGHBOURS)
    best = int((tried == choice.shapes).mean(axis=1).argmax())
    single, guesses = neighbour_guesses(rows, known.shapes, test.view(columns), (1, NEIGHBOURS[best]))
    num_shapes = int(known.shapes.max()) + 1
    return Reader(NEIGHBOURS[best], guesses, cover_hart_accuracy(float((single == test.shapes).mean()), num_shapes))


def cover_hart_accuracy(nearest: float, num_shapes: int) -> float:
    """Largest accuracy any reader can have where the nearest of infinitely many known touches has this one.

    >>> cover_hart_accuracy(1.0, 4), cover_hart_accuracy(0.25, 4)
    (1.0, 0.25)
    """
    share = (num_shapes - 1) / num_shapes
    return 1.0 - share * (1.0 - float(np.sqrt(max(0.0, 1.0 - (1.0 - nearest) / share))))
