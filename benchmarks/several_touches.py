"""Accuracy after several touches of one object, by reader and number of hypotheses.

python -m benchmarks.several_touches --scene coarse --hypotheses 64 512 4096

The joint model of every reader with every number of hypotheses, and the model of touches that are independent given the
shape. Models are fitted to the calibration split; all read the same touches of the test split, in several random orders
of poses, because the first poses matter.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from itertools import product
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import tyro
from numpy.typing import NDArray

from activetouch.data.dataset import TouchSet, read_split
from activetouch.data.manifest import Manifest
from activetouch.perception.reader import HypothesisTable, TactileReader
from activetouch.sensor_files import READER_FILE
from belief.constraints import NotEmpty
from belief.files import claim_folder, ends_claims, write_text
from belief.observation_model import ArrayModel
from belief.observation_model.likelihood_ratio import RatioModel
from belief.observation_model.rigid_body import RigidBodyModel
from belief.observation_model.selection import log_posteriors
from belief.problem import Touch
from belief.statistics import cluster_bootstrap, wilson_interval
from belief.table import Table
from belief.touch_batch import TouchBatch
from benchmarks.belief_cost import belief_cost
from benchmarks.precision import PRECISIONS, in_precision
from experiments.command_line.arguments import BadArgument, Count, Seed, check_arguments
from experiments.command_line.console import plain_console
from experiments.scene_choice import named_scene, repeats_folder
from experiments.sensor.scores import read_touches
from experiments.sensor_choice import open_collection, require_collection, sensor_folder

_ROUNDS = 30
"""Rounds of timing, of which the median counts."""


@dataclass(frozen=True)
class AfterTouches:
    """Scores of a model after some touches of an object, with 95 % intervals over objects; NLL in nats.

    The Wilson interval of accuracy is too wide where objects have several sequences. ``gap`` is stated minus accuracy.
    """

    touches: int
    accuracy: float
    accuracy_interval: tuple[float, float]
    nll: float
    nll_interval: tuple[float, float]
    stated: float
    gap: float
    gap_interval: tuple[float, float]


def after_touches(
    log_probs: NDArray[np.float64], shapes: NDArray[np.int64], objects: NDArray[np.int64], touches: int, seed: int
) -> AfterTouches:
    """Scores of the log posteriors ``(S, K)`` after S sequences, with true ``shapes (S,)`` of ``objects (S,)``."""
    right, stated = log_probs.argmax(axis=1) == shapes, np.exp(log_probs.max(axis=1))
    number, num_objects = np.arange(len(shapes)), len(np.unique(objects))
    nll, *nll_interval = cluster_bootstrap(-log_probs[number, shapes], objects, np.random.default_rng(seed))
    gap, *gap_interval = cluster_bootstrap(stated - right, objects, np.random.default_rng(seed))
    return AfterTouches(
        touches,
        float(right.mean()),
        wilson_interval(round(right.mean() * num_objects), num_objects),
        nll,
        (nll_interval[0], nll_interval[1]),
        float(stated.mean()),
        gap,
        (gap_interval[0], gap_interval[1]),
    )


@dataclass(frozen=True)
class Entry:
    """One reader with one observation model; ``hypotheses`` of each shape are 0 for the independent model."""

    network: str
    precision: str
    hypotheses: int
    results: tuple[AfterTouches, ...]
    read_milliseconds: float
    update_milliseconds: float
    megabytes: float

    @property
    def name(self) -> str:
        """Network and model in words."""
        return f"{self.reader}, " + (f"N = {self.hypotheses}" if self.hypotheses else "independent")

    @property
    def reader(self) -> str:
        """Network and precision in words."""
        return f"{self.network}, {self.precision}"

    @property
    def milliseconds(self) -> str:
        """Times to read one image, and to update the belief with it, in words."""
        return f"{self.read_milliseconds:.1f} + {self.update_milliseconds:.1f}"


@dataclass(frozen=True)
class SeveralTouches:
    """Measure accuracy, NLL and calibration after several touches of one object, and the time that a touch takes.

    The poses of an object are in random orders, each at most once.

    For example:

        python -m benchmarks.several_touches --scene hard
        python -m benchmarks.several_touches --scene gel --hypotheses 64 512 --readers runs/train-8/reader.safetensors
        python -m benchmarks.several_touches --scene gel --precisions float32 int8
    """

    scene: str = "gel"
    """Name of the scene."""
    readers: tuple[Path, ...] = ()
    """From activetouch train; that of the scene's shipped sensor by default."""
    data: Path | None = None
    """Folder of the collection with repeats; data/SCENE-repeats by default."""
    hypotheses: Annotated[tuple[Count, ...], NotEmpty()] = (2048,)
    """Numbers of hypotheses of each shape."""
    precisions: Annotated[tuple[Literal[PRECISIONS], ...], NotEmpty()] = PRECISIONS[:1]  # type: ignore[valid-type]
    """Arithmetic of the readers' networks; int8 needs what training needs."""
    touches: Annotated[tuple[Count, ...], NotEmpty()] = (1, 2, 3, 4, 6)
    """Numbers of touches of an object."""
    orders: Count = 6
    """Random orders of the poses of each object. Intervals are over objects."""
    seed: Seed = 0
    """Of the orders of poses and of the intervals."""
    out: Path = Path("runs/several-touches")
    """Folder for numbers, table and figure."""

    @ends_claims
    def run(self) -> None:
        """Read, fit, evaluate, write and print."""
        check_arguments(self)
        scene = named_scene(self.scene).scene
        if max(self.touches) > len(scene.poses):
            raise BadArgument(
                f"--touches must be at most {len(scene.poses)}, one in each pose, got {max(self.touches)}"
            )
        claim_folder(self.out)
        data = self.data if self.data is not None else repeats_folder(self.scene)
        manifest = open_collection(data, self.scene, repeats=True)
        calibration, test = read_split(data, "calibration"), first_round(read_split(data, "test"), len(scene.poses))
        entries = []
        for path, precision in product(
            self.readers or (sensor_folder(None, self.scene) / READER_FILE,), self.precisions
        ):
            reader = in_precision(TactileReader.load(path), precision)
            require_collection(data, manifest, reader.card, None)
            known = read_touches(reader, calibration, f"{path}, calibration touches").sequence(0)
            known_test = read_touches(reader, test, f"{path}, test touches")
            read = in_random_orders(known_test, test, self.orders, self.seed)
            seconds = _milliseconds(partial(reader.read, test.images[:1]))
            for number in (0,) if reader.hypotheses is None else (0, *self.hypotheses):
                model = _fitted(known, calibration, manifest, HypothesisTable(reader, scene), number)
                truth = test.shapes[:: len(scene.poses)]
                entries.append(self._entry(reader, precision, seconds, number, model, read, truth))
        num_objects = len(np.unique(test.object_ids))
        shown = table(entries, self.scene, num_objects)
        settings = {"scene": self.scene, "seed": self.seed, "objects": num_objects, "orders": self.orders}
        record = settings | {"entries": list(map(asdict, entries))}
        for name, text in (
            ("several-touches.json", json.dumps(record, indent=1) + "\n"),
            ("several-touches.md", shown.markdown() + "\n"),
        ):
            write_text(self.out / name, text)
        draw(entries, self.scene, self.out / "several-touches.svg")
        console = plain_console()
        console.print(f"{shown.title}\n{shown.note}\n")
        for entry in entries:
            print(table_of(entry), end="\n\n")
        print(f"wrote {self.out}/several-touches.md, .json and .svg")

    def _entry(
        self,
        reader: TactileReader,
        precision: str,
        read_milliseconds: float,
        number: int,
        model: ArrayModel,
        read: TouchBatch,
        truth: NDArray[np.int64],
    ) -> Entry:
        cost = belief_cost(model, 0 if read.features is None else read.features.shape[-1])
        shapes, objects = np.tile(truth, self.orders), np.tile(np.arange(len(truth)), self.orders)
        return Entry(
            f"{reader.card.backbone} {reader.card.input_size} px",
            precision,
            number,
            tuple(
                after_touches(log_posteriors(model, read.first(n)), shapes, objects, n, self.seed) for n in self.touches
            ),
            read_milliseconds,
            cost.update,
            cost.memory,
        )


def first_round(touches: TouchSet, num_poses: int) -> TouchSet:
    """The first touch of every object in each pose."""
    each = len(touches.poses) // len(np.unique(touches.object_ids))
    return touches.select(np.arange(len(touches.poses)) % each < num_poses)


def in_random_orders(touches: TouchBatch, truth: TouchSet, number: int, seed: int) -> TouchBatch:
    """The first touch of every object in each pose, in random orders, ``(number · M, P)``; the M objects in turn."""
    num_objects = len(np.unique(truth.object_ids))
    rows = np.tile(np.arange(num_objects), number)[:, None]
    poses = np.tile(np.arange(truth.poses.max() + 1), (len(rows), 1))
    orders = np.random.default_rng(seed).permuted(poses, axis=1)
    return touches.reshaped((num_objects, -1)).take((rows, orders))


def table_of(entry: Entry) -> Table:
    """Results of one reader with one model; the title has its costs."""
    rows = [(r.touches, r.accuracy, r.accuracy_interval, r.nll, r.gap, r.gap_interval) for r in entry.results]
    scores = [("accuracy", ".3f"), ("95 %", ".3f"), ("NLL", ".4f"), ("gap", "+.3f"), ("gap, 95 %", "+.3f")]
    return Table(f"{entry.name}: {entry.milliseconds} ms", [("touches", "d"), *scores], rows)


def table(entries: Sequence[Entry], scene: str, num_objects: int) -> Table:
    """Results of all readers and models, and what they cost."""
    parts = [(entry, table_of(entry)) for entry in entries]
    return Table(
        f"scene {scene}, {num_objects} unseen objects, poses in random orders",
        ["reader, model", *parts[0][1].columns, "ms"],
        [(entry.name, *row, entry.milliseconds) for entry, part in parts for row in part.rows],
        "gap: stated confidence minus accuracy. ms: to read one image, and to update the belief with it.",
    )


def draw(entries: Sequence[Entry], scene: str, path: Path) -> None:
    """Draw NLL against the time of a touch, one panel per number of touches up to three, or for the fewest."""
    from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

    from experiments.report import PALETTE, figure

    readers = list(dict.fromkeys((entry.network, entry.precision) for entry in entries))
    networks = list(dict.fromkeys(network for network, _ in readers))
    shown = [n for n, result in enumerate(entries[0].results) if result.touches <= 3]
    shown = shown or [int(np.argmin([result.touches for result in entries[0].results]))]
    with figure((3.2 * len(shown) + 1.8, 3.6), path) as drawn:
        panels = np.atleast_1d(drawn.subplots(1, len(shown)))
        for axes, n in zip(panels, shown, strict=True):
            for network, precision in readers:
                ours = [e for e in entries if (e.network, e.precision) == (network, precision)]
                colour, plain = PALETTE[networks.index(network) % len(PALETTE)], precision == PRECISIONS[0]
                style = {"color": colour, "linestyle": "-" if plain else ":", "markersize": 5, "linewidth": 1}
                for marker, some in (
                    ("s", [e for e in ours if not e.hypotheses]),
                    ("o", [e for e in ours if e.hypotheses]),
                ):
                    x = [e.read_milliseconds + e.update_milliseconds for e in some]
                    y = np.maximum([e.results[n].nll for e in some], 1e-5)
                    face = colour if plain else "none"
                    label = f"{network}, {precision}" if marker == "o" else None
                    axes.plot(x, y, marker=marker, markerfacecolor=face, label=label, **style)
                    for place, e in zip(zip(x, y, strict=True), some, strict=True):
                        text = str(e.hypotheses) if e.hypotheses and plain else ""
                        axes.annotate(text, place, xytext=(3, 3), textcoords="offset points", fontsize=7)
            touches = entries[0].results[n].touches
            axes.set(xscale="log", yscale="log", title=f"{touches} touch{'es' * (touches > 1)}")
            axes.set(xlabel="ms per touch, read and update")
            for axis in (axes.xaxis, axes.yaxis):
                axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
                axis.set_major_formatter(StrMethodFormatter("{x:g}"))
                axis.set_minor_formatter(NullFormatter())
            axes.grid(alpha=0.25)
        panels[0].set_ylabel("NLL of the shape [nats]")
        drawn.legend(*panels[0].get_legend_handles_labels(), loc="outside right upper", frameon=False, fontsize=8)
        drawn.suptitle(
            f"scene {scene}; circles: one body, with numbers of hypotheses of each shape; squares: independent",
            fontsize=9,
        )


def _fitted(
    known: Sequence[Touch], truth: TouchSet, manifest: Manifest, hypotheses: HypothesisTable, number: int
) -> ArrayModel:
    """The joint model with so many hypotheses; the model of independent touches for 0."""
    shapes, num_poses = manifest.shape_labels, len(manifest.pose_labels)
    if not number:
        return RatioModel.fit(known, truth.shapes, truth.object_ids, shape_labels=shapes, num_poses=num_poses)
    return RigidBodyModel.fit(
        known,
        truth.shapes,
        truth.object_ids,
        shape_labels=shapes,
        num_poses=num_poses,
        embed=hypotheses,
        num_hypotheses=number,
    )


def _milliseconds(call: Callable[[], object]) -> float:
    """Median processor time of a call."""
    times = []
    for _ in range(_ROUNDS):
        started = time.thread_time()
        call()
        times.append(1e3 * (time.thread_time() - started))
    return float(np.median(times))


if __name__ == "__main__":
    tyro.cli(SeveralTouches, config=(tyro.conf.OmitSubcommandPrefixes,)).run()
