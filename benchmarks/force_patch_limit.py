"""Bounds on the Bayes-optimal accuracy of one touch in the scene ``paper``.

Run: python -m benchmarks.force_patch_limit                              (nearest neighbours in the numbers of a press)
     python -m benchmarks.force_patch_limit --learned-from data/paper    (a network on every pixel)

A force-patch image (paper §5.5) is a function of force and contact point in one short window. By the data-processing
inequality, no reader of the image is better than the best reader of these numbers. Nearest neighbours read them:

* Rotated and mirrored presses are equally likely, so the contact point is folded into the eighth of the square pad with
  ``0 ≤ across ≤ along``.
* Within the window little changes, and smoothly: the mean, the change from first to last, and the bend are kept.
* The contact point creeps by nanometres. Where the image drawn with the mean point is identical, the creep is set to 0.
* Every number is replaced by its rank, so units do not matter.

The accuracy of a vote is a lower bound. The single nearest neighbour gives an upper bound, given enough known touches
(Cover and Hart 1967, :func:`cover_hart_accuracy`). Images need not show all of these
numbers, so a network on the pixels around the spot, at full resolution, gives a lower bound for readers of images.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import tyro
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.spatial import KDTree

from activetouch.data.dataset import read_split
from activetouch.data.manifest import read_manifest
from activetouch.pressing.contact import Contact, Trace
from activetouch.rendering import ForcePatchRenderer
from activetouch.scene import Scene
from belief.table import Table
from benchmarks.bayes_error.findings import Findings, chunks, paired_difference, words
from benchmarks.held_out import LimitStudy, Stream, held_out_touch, share
from experiments.parallel import default_jobs, progress_bar, run_tasks
from experiments.scene_choice import SceneChoice
from experiments.sensor_choice import open_sensor, require_collection

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

NEIGHBOURS = (1, 3, 5, 9, 15, 25, 51, 101)
"""Numbers of neighbours that are tried."""

_DRAWN = ("force", "along", "across", "force change", "force bend", "along change", "across change")
NUMBERS = (*_DRAWN, "sideways force", "depth")
"""Numbers of a press [N, m], with the contact point folded. No image shows the last two."""
_WHOLE = "force, contact point, course of both"

VIEWS: Mapping[str, tuple[str, ...]] = {
    "force alone": ("force",),
    "distance of the contact point from the pad's centre alone": ("radius",),
    "contact point": ("along", "across"),
    "force and distance": ("force", "radius"),
    "force and contact point": ("force", "along", "across"),
    "force, contact point, change of the force": ("force", "along", "across", "force change"),
    "force, contact point, course of the force": NUMBERS[:5],
    _WHOLE: _DRAWN,
    "the same and the sideways force (not in the image)": NUMBERS[:8],
    "force and depth (depth is not in the image)": ("force", "depth"),
    "force, contact point, and depth (depth is not in the image)": ("force", "along", "across", "depth"),
}
"""Inputs of readers; ``radius`` is the length of (along, across)."""


@dataclass(frozen=True, eq=False)
class PressNumbers:
    """Numbers of n touches.

    Attributes:
        shapes: shapes of the touched objects, ``(n,)``.
        values: columns as :data:`NUMBERS`, ``(n, 9)``.
    """

    shapes: Ints
    values: Floats

    def view(self, columns: Sequence[str]) -> Floats:
        """Columns by name, ``(n, D)``; ``radius`` is computed."""
        known = dict(zip(NUMBERS, self.values.T, strict=True))
        known["radius"] = np.hypot(known["along"], known["across"])
        return np.column_stack([known[name] for name in columns])

    def first(self, count: int) -> PressNumbers:
        """The first touches."""
        return PressNumbers(self.shapes[:count], self.values[:count])


def press_numbers(contact: Contact, renderer: ForcePatchRenderer) -> Floats:
    """The numbers of a press, as :data:`NUMBERS`; zeros if there was no contact in the window.

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
    """The rows of a press's trace from which its image is drawn; none if the press never paused.

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
    """Shapes, numbers and (of test touches only) images of held-out touches, after the number of the first."""
    assert isinstance(scene.renderer, ForcePatchRenderer), "the caller chose this scene for its renderer"
    shapes, rows, readings = [], [], []
    for number in numbers:
        touch = held_out_touch(scene, seed, stream, number)
        shapes.append(touch.shape)
        rows.append(press_numbers(touch.contact, scene.renderer))
        if stream is Stream.TEST:
            readings.append(touch.reading)
    return numbers[0], np.array(shapes), np.array(rows), readings


def neighbour_guesses(known: Floats, known_shapes: Ints, asked: Floats, num_neighbours: Sequence[int]) -> Ints:
    """Majority votes of nearest neighbours, by rank in each column.

    Args:
        known: rows of touches with known shape, ``(n, D)``.
        known_shapes: their shapes, ``(n,)``.
        asked: rows to classify, ``(m, D)``.
        num_neighbours: numbers of voting neighbours, ``(V,)``.

    Returns:
        Shapes ``(V, m)``; of shapes with equally many votes, the shape of the nearest neighbour.
    """
    ranks, places = _ranks(known, known), _ranks(known, asked)
    most = min(max(num_neighbours), len(known))
    _, nearest = KDTree(ranks).query(places, k=most)
    votes = np.eye(known_shapes.max() + 1)[known_shapes[nearest.reshape(len(asked), most)]]  # (m, most, K)
    # Nearer neighbours have slightly larger weights, which only break ties.
    counts = np.cumsum(votes * (1.0 + 1e-6 / np.arange(1, most + 1))[:, None], axis=1)
    return np.stack([counts[:, min(k, most) - 1].argmax(axis=1) for k in num_neighbours])


def _ranks(known: Floats, asked: Floats) -> Floats:
    """Fraction of known values below each value, by column, with ties at the middle, ``(m, D)``."""
    columns = []
    for reference, values in zip(np.sort(known, axis=0).T, asked.T, strict=True):
        below, upto = (np.searchsorted(reference, values, side) for side in ("left", "right"))
        columns.append((below + upto) / (2 * len(reference)))
    return np.stack(columns, axis=1)


@dataclass(frozen=True, eq=False)
class Reader:
    """Result of a neighbour reader.

    Attributes:
        num_neighbours: number of voting neighbours, chosen on separate touches.
        guesses: predicted shapes of the test touches, ``(m,)``.
        upper: upper bound on the accuracy of any reader, from the single nearest neighbour.
    """

    num_neighbours: int
    guesses: Ints
    upper: float


def read_by_neighbours(known: PressNumbers, choice: PressNumbers, test: PressNumbers, columns: Sequence[str]) -> Reader:
    """Choose the number of neighbours on ``choice``, and classify ``test`` with it."""
    rows = known.view(columns)
    tried = neighbour_guesses(rows, known.shapes, choice.view(columns), NEIGHBOURS)
    best = int((tried == choice.shapes).mean(axis=1).argmax())
    single, guesses = neighbour_guesses(rows, known.shapes, test.view(columns), (1, NEIGHBOURS[best]))
    num_shapes = int(known.shapes.max()) + 1
    return Reader(NEIGHBOURS[best], guesses, cover_hart_accuracy(float((single == test.shapes).mean()), num_shapes))


def cover_hart_accuracy(nearest: float, num_shapes: int) -> float:
    """Largest accuracy that any reader can have, given that of the nearest of infinitely many known touches.

    With K shapes, the error e of the nearest neighbour and the least possible error e* satisfy
    e ≤ e* (2 - e* K / (K - 1)) (Cover and Hart 1967).

    >>> cover_hart_accuracy(1.0, 4), cover_hart_accuracy(0.25, 4)
    (1.0, 0.25)
    """
    share = (num_shapes - 1) / num_shapes
    return 1.0 - share * (1.0 - float(np.sqrt(max(0.0, 1.0 - (1.0 - nearest) / share))))


_TOUCHES_PER_TASK = 50


@dataclass(frozen=True)
class NearestNeighbours:
    """Neighbour readers of the numbers of a press."""

    known: int = 20_000
    """Touches with known shape."""
    choice: int = 3_000
    """Touches for the choice of the number of neighbours."""

    def measure(self, study: LimitStudy) -> Findings:
        """Measure, and say what was found."""
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
                "num_neighbours": readers[-1].num_neighbours,
                "upper": readers[-1].upper,
                "curve": [float(np.mean(reader.guesses == test.shapes)) for reader in readers],
                "upper_curve": [reader.upper for reader in readers],
                "above_classifier": paired_difference(right, classifier, study.seed),
            }
        creep = test.view(("along change", "across change")).any(axis=1)
        numbers = {
            "sizes": sizes,
            "views": views,
            "classifier": share(classifier),
            "creep_shows": share(creep),
        }
        title = "Bayes-optimal accuracy of one touch, from the numbers behind the images"
        return Findings(title, _number_sentences(study, numbers), _number_tables(numbers), numbers)


def _collect(study: LimitStudy, stream: Stream, count: int) -> tuple[PressNumbers, NDArray[np.uint8]]:
    tasks = [
        partial(collect_numbers, study.scene, study.seed, stream, numbers)
        for numbers in chunks(count, _TOUCHES_PER_TASK)
    ]
    parts = sorted(run_tasks(tasks, study.jobs, f"pressing, {stream.name.lower()}"), key=lambda part: part[0])
    shapes, values = (np.concatenate(column) for column in list(zip(*parts, strict=True))[1:3])
    readings = [reading for part in parts for reading in part[3]]
    return PressNumbers(shapes, values), np.stack(readings) if readings else np.empty(0, np.uint8)


def _number_sentences(study: LimitStudy, numbers: dict[str, Any]) -> list[str]:
    whole, depth = numbers["views"][_WHOLE], numbers["views"]["force and depth (depth is not in the image)"]
    return [
        f"{study.touches} held-out touches, each of another object, seed {study.seed}; {numbers['sizes'][-1]} known "
        f"touches. Neighbours read {words(whole)} correctly from {_WHOLE}, a lower bound for readers of these numbers. "
        f"The single nearest neighbour gives the upper bound {whole['upper']:.4f}. With half as many known touches the "
        f"bounds were {whole['curve'][-2]:.4f} and {whole['upper_curve'][-2]:.4f}: a bound that still rises has not "
        "converged.",
        f"The classifier reads {words(numbers['classifier'])} of the same touches correctly; neighbours minus "
        f"classifier: {words(whole['above_classifier'], '+')}.",
        f"The creep of the contact point changes the image of {numbers['creep_shows']['value']:.1%} of the touches; it "
        "is used in these only.",
        f"Force and depth together give {words(depth)}, but the images do not show the depth.",
    ]


def _number_tables(numbers: dict[str, Any]) -> list[Table]:
    rows = [
        (name, words(view), f"{view['upper']:.3f}", str(view["num_neighbours"]), curve_cell(view["curve"]))
        for name, view in numbers["views"].items()
    ]
    rows.append(("the classifier, from the image", words(numbers["classifier"]), "", "", ""))
    headings = ("input", "neighbours", "upper bound", "votes", curve_heading(numbers["sizes"]))
    return [Table("Accuracy from the numbers of a touch", headings, rows)]


REACH = 18
"""Pixels to each side of a spot's centre; enough for a disc of 2 N on a pad of 128 taxels."""
PLACE = 5
"""Number of values after the pixels: along, across, their fractions of a pixel, brightness."""
_AT_ONCE, _BATCH = 500, 256


def close_ups(images: NDArray[np.uint8], renderer: ForcePatchRenderer) -> Floats:
    """Input of the reader: the pixels around the spot, its place and its brightness.

    Args:
        images: force patches, ``(N, n, n, 3)``.
        renderer: the renderer that drew them.

    Returns:
        ``(N, (2 REACH + 1)² + PLACE)``: pixels in [0, 1]; the spot's distances from the pad's centre, relative to half
        the pad, ``0 ≤ across ≤ along``; their fractions of a pixel; the root of the mean brightness.

    Raises:
        ValueError: these are no force patches of this renderer.
    """
    blocks = [_close_ups(levels(images[n : n + _AT_ONCE], renderer.colormap)) for n in range(0, len(images), _AT_ONCE)]
    return np.concatenate(blocks)


def _close_ups(levels: NDArray[np.uint8]) -> Floats:
    count, edge, _ = levels.shape
    brightness = np.maximum(levels.sum(axis=(1, 2), dtype=np.int64), 1)
    offset = np.arange(edge) - (edge - 1) / 2
    place = np.stack([levels.sum(axis=other, dtype=np.int64) @ offset for other in (2, 1)], axis=1)
    place /= brightness[:, None]  # (N, 2): row, column
    nearest = np.rint(place + (edge - 1) / 2).astype(int)
    rest = place + (edge - 1) / 2 - nearest
    padded = np.pad(levels, ((0, 0), (REACH, REACH), (REACH, REACH)))
    spots = sliding_window_view(padded, (2 * REACH + 1,) * 2, axis=(1, 2))[np.arange(count), *nearest.T]
    for axis in (0, 1):
        mirrored = place[:, axis] < 0.0
        spots[mirrored] = np.flip(spots[mirrored], axis=axis + 1)
        place[mirrored, axis] *= -1.0
        rest[mirrored, axis] *= -1.0
    turned = place[:, 0] < place[:, 1]
    spots[turned] = spots[turned].swapaxes(1, 2)
    place[turned], rest[turned] = place[turned, ::-1], rest[turned, ::-1]
    columns = [spots.reshape(count, -1) / 255, place / (edge / 2), rest, np.sqrt(brightness / (255 * edge**2))[:, None]]
    return np.hstack(columns).astype(np.float32)


@dataclass(frozen=True)
class CloseReader:
    """A network of two hidden layers (256 and 128 units), trained with AdamW and a one-cycle schedule.

    Attributes:
        epochs: passes over the known touches.
    """

    epochs: int = 30

    def learn(self, known: Floats, shapes: Ints, seed: int) -> Callable[[Floats], Floats]:
        """Train on known touches.

        Args:
            known: one row per touch, ``(N, D)``.
            shapes: shapes of the touches, ``(N,)``.
            seed: seed of weights and order.

        Returns:
            Function from rows ``(M, D)`` to log probabilities ``(M, K)``.
        """
        import torch
        from torch import nn

        # Few spots light a pixel at the rim, so a small standard deviation is not scaled up to one.
        mean, scale = known.mean(axis=0), known.std(axis=0) + 1 / 64
        rows, labels = torch.from_numpy((known - mean) / scale), torch.from_numpy(shapes)
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            network = nn.Sequential(
                nn.Linear(known.shape[1], 256), nn.SiLU(), nn.Linear(256, 128), nn.SiLU(),
                nn.Linear(128, int(shapes.max()) + 1), nn.LogSoftmax(dim=1),
            )  # fmt: skip
        optimizer = torch.optim.AdamW(network.parameters(), weight_decay=0.05)
        steps = self.epochs * -(-len(rows) // _BATCH)
        schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, 2e-3, total_steps=steps)
        rng = np.random.default_rng(seed)
        for _ in range(self.epochs):
            for batch in torch.from_numpy(rng.permutation(len(rows))).split(_BATCH):
                optimizer.zero_grad()
                nn.functional.nll_loss(network(rows[batch]), labels[batch]).backward()
                optimizer.step()
                schedule.step()
        network.eval()

        def read(asked: Floats) -> Floats:
            with torch.inference_mode():
                return network(torch.from_numpy((asked - mean) / scale)).numpy()

        return read


def levels(images: NDArray[np.uint8], colormap: str) -> NDArray[np.uint8]:
    """Brightness of each pixel before it was coloured; the lowest of levels with the same colour.

    Args:
        images: images of a sensor without faults, ``(..., 3)``.
        colormap: name of the matplotlib colormap.

    Returns:
        0 to 255, ``(...)``.

    Raises:
        ValueError: a pixel has a colour that is not in the colormap.
    """
    table = matplotlib.colormaps[colormap](np.arange(256))[:, :3]
    colours = _packed(np.rint(255 * table).astype(np.uint8))
    level = np.full(1 << 24, -1, np.int16)
    level[colours[::-1]] = np.arange(255, -1, -1)
    found = level[_packed(images)]
    if (found < 0).any():
        where = np.argwhere(found < 0)[0].tolist()
        raise ValueError(
            f"the pixel at {where} has the colour {images[tuple(where)].tolist()}, which {colormap} does not have: a "
            "fault or another renderer changed these images, or they are not force patches"
        )
    return found.astype(np.uint8)


def _packed(colours: NDArray[np.uint8]) -> NDArray[np.int32]:
    """Colours ``(..., 3)`` as one number each, ``(...)``."""
    return colours.astype(np.int32) @ np.array([1 << 16, 1 << 8, 1], np.int32)


_PIXEL_PARTS = (4, 2, 1)
WHOLE_SPOT = "every pixel of the spot, its place, its brightness"
PIXEL_VIEWS: Mapping[str, slice] = {"its place and brightness": slice(-PLACE, None), WHOLE_SPOT: slice(None)}
"""Parts of a close-up, as inputs of readers."""


@dataclass(frozen=True)
class PixelReader:
    """A reader trained on full-resolution images of a collection."""

    collection: Path
    """Folder of the touches to learn from."""
    reader: CloseReader = field(default_factory=CloseReader)
    """Network and its training."""

    def measure(self, study: LimitStudy) -> Findings:
        """Measure, and say what was found."""
        renderer = study.scene.renderer
        assert isinstance(renderer, ForcePatchRenderer), "the caller chose this scene for its renderer"
        manifest = read_manifest(self.collection)
        require_collection(self.collection, manifest, study.sensor.reader.card, None)
        train = read_split(self.collection, "train")
        order = np.random.default_rng(study.seed).permutation(np.unique(train.object_ids))  # parts are of whole objects
        known, readings = close_ups(train.images, renderer), study.read()
        asked = close_ups(readings, renderer)
        classifier = study.classify(readings).argmax(axis=1) == study.shapes
        objects = [order[:size] for part in _PIXEL_PARTS if (size := len(order) // part)]
        parts = [np.isin(train.object_ids, some) for some in objects]
        views: dict[str, Any] = {}
        with progress_bar() as progress:
            for name, columns in PIXEL_VIEWS.items():
                curve = []
                for rows in progress.track(parts, description=f"readers of {name}"):
                    seen, shapes = known[rows, columns], train.shapes[rows]
                    read = self.reader.learn(seen, shapes, study.seed)
                    right = read(asked[:, columns]).argmax(axis=1) == study.shapes
                    curve.append(float(right.mean()))
                views[name] = {
                    **share(right),
                    "curve": curve,
                    "learned_from": float(np.mean(read(seen).argmax(axis=1) == shapes)),
                    "above_classifier": paired_difference(right, classifier, study.seed),
                }
        numbers: dict[str, Any] = {
            "sizes": [int(rows.sum()) for rows in parts],
            "views": views,
            "classifier": share(classifier),
        }
        return Findings("Accuracy from every pixel", _pixel_sentences(study, numbers), _pixel_tables(numbers), numbers)


def _pixel_sentences(study: LimitStudy, numbers: dict[str, Any]) -> list[str]:
    whole = numbers["views"][WHOLE_SPOT]
    return [
        f"{study.touches} held-out touches, each of another object, seed {study.seed}; {numbers['sizes'][-1]} known "
        f"touches. The reader has accuracy {words(whole)}, a lower bound for readers of the images, and "
        f"{whole['learned_from']:.4f} on its training touches. The classifier has {words(numbers['classifier'])} on "
        f"the same touches; reader minus classifier: {words(whole['above_classifier'], '+')}."
    ]


def _pixel_tables(numbers: dict[str, Any]) -> list[Table]:
    rows = [
        (name, words(view), f"{view['learned_from']:.3f}", curve_cell(view["curve"]))
        for name, view in numbers["views"].items()
    ]
    rows.append(("the classifier", words(numbers["classifier"]), "", ""))
    headings = ("input", "accuracy", "on its training touches", curve_heading(numbers["sizes"]))
    return [Table("Accuracy from every pixel of a touch", headings, rows)]


def curve_heading(sizes: Sequence[int]) -> str:
    """Heading of a column of accuracies, one per number of known touches."""
    return f"with {', '.join(map(str, sizes))} known"


def curve_cell(accuracies: Sequence[float]) -> str:
    """Accuracies for growing numbers of known touches, in one cell."""
    return " ".join(f"{accuracy:.3f}" for accuracy in accuracies)


@dataclass(frozen=True)
class Main:
    """Bound the Bayes-optimal accuracy of one touch in the scene ``paper``."""

    learned_from: Path | None = None
    """Collection to train a reader of every pixel on; without it, nearest neighbours read the numbers of a press."""
    touches: int = 6_000
    """Held-out touches for the measurement, each of another object."""
    known: int = 20_000
    """Touches with known shape, among which neighbours are searched."""
    choice: int = 3_000
    """Touches for the choice of the number of neighbours."""
    seed: int = 0
    """Seed of all touches and intervals."""
    out: Path = Path("runs/limit-paper")
    """Folder for limit.json and limit.md."""
    jobs: int = default_jobs()
    """Number of processes; the results do not depend on it."""

    def run(self) -> None:
        """Measure, print and write."""
        sensor = open_sensor(None, SceneChoice("paper"))
        study = LimitStudy(sensor, self.touches, self.seed, self.jobs)
        estimator = (
            NearestNeighbours(self.known, self.choice) if self.learned_from is None else PixelReader(self.learned_from)
        )
        findings = estimator.measure(study)
        findings.write(self.out, {"scene": "paper", "seed": self.seed, "num_touches": self.touches})
        print((self.out / "limit.md").read_text())


if __name__ == "__main__":
    tyro.cli(Main).run()
