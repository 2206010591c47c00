"""The accuracy and cost of trained networks, by backbone, runtime and batch size.

All are timed in turn, round after round, so that a busy moment of the machine meets all of them; a time is the median
over rounds, and the ratio to the reference is the median of the ratios within a round.

    python -m benchmarks.frontier --checkpoints runs/tiny/state.safetensors runs/atto/state.safetensors
"""

from __future__ import annotations

import copy
import json
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, fields
from functools import partial
from pathlib import Path
from shutil import which
from typing import TYPE_CHECKING, Annotated, cast

import numpy as np
import tyro
from numpy.typing import NDArray

from activetouch.data.dataset import read_split
from activetouch.extras import require_extra
from activetouch.perception.card import ClassifierCard, card_from
from activetouch.perception.reader import TactileReader
from belief.claims import claim_folder, ends_claims
from belief.files import write_text
from belief.sealed_tensors import read_tensors
from belief.table import Table
from benchmarks.reader_scores import Scores, draw_errors, scores
from experiments.command_line.arguments import BadArgument, Count, Jobs, NotEmpty, Seed, check_arguments
from experiments.parallel import progress_bar
from experiments.scene_choice import collection_folder
from experiments.sensor_choice import open_collection, require_collection

if TYPE_CHECKING:
    from activetouch.perception.classifier import TouchClassifier, TouchNetwork


@dataclass(frozen=True)
class Entry:
    """One network in one runtime.

    Attributes:
        network: backbone and input size.
        runtime: what computes it, in what precision.
        scores: on the test split.
        megabytes: of its file.
        parameters: of the network.
        milliseconds: of one touch, by batch size: images in, logits out.
        ratio: of that time to the reference's, by batch size.
    """

    network: str
    runtime: str
    scores: Scores
    megabytes: float
    parameters: int
    milliseconds: dict[int, float]
    ratio: dict[int, float]


@dataclass(frozen=True)
class Frontier:
    """Measure accuracy, NLL, time and size of plain classifiers of shapes on the same test touches.

    Every network runs in torch (as it is, compiled, in bfloat16, with 8-bit integers) and in ONNX Runtime, which is
    what sensors use. The first checkpoint in torch is the reference of the ratios.

    For example:

        python -m benchmarks.frontier --checkpoints runs/tiny/state.safetensors runs/atto/state.safetensors
    """

    checkpoints: Annotated[tuple[Path, ...], NotEmpty()]
    """States of activetouch train --recipe large or paper."""
    scene: str = "gel"
    """Whose touches to read."""
    data: Path | None = None
    """Folder of the collection; data/SCENE by default."""
    touches: Count | None = None
    """Of the test split, to read; all by default."""
    batches: Annotated[tuple[Count, ...], NotEmpty()] = (1, 64)
    """Batch sizes to time."""
    rounds: Count = 15
    """Of timing."""
    threads: Jobs = 1
    """Of the linear algebra."""
    seed: Seed = 0
    """Of the intervals."""
    out: Path = Path("runs/frontier")
    """Folder for numbers, table and figure."""

    @ends_claims
    def run(self) -> None:
        """Read, time, write and print."""
        check_arguments(self)
        require_extra("train")
        import torch

        from activetouch.perception.classifier import TouchNetwork

        claim_folder(self.out)
        torch.set_num_threads(self.threads)
        data = self.data if self.data is not None else collection_folder(self.scene)
        manifest = open_collection(data, self.scene, repeats=False)
        calibration, test = read_split(data, "calibration"), read_split(data, "test")
        if self.touches is not None:
            test = test.select(np.arange(min(self.touches, len(test.images))))
        variants: list[tuple[Path, str, TactileReader | TouchClassifier]] = []
        for path in self.checkpoints:
            single = trained(path)
            if single.card.knows_orientations:
                raise BadArgument(
                    f"--checkpoints must be plain classifiers (train --recipe large), {path} embeds images"
                )
            require_collection(data, manifest, single.card, None)
            variants += [(path, name, reader) for name, reader in runtimes(single, manifest.image_shape)]
        times = {b: self._time([reader for *_, reader in variants], test.images, b) for b in self.batches}
        entries = []
        with progress_bar() as progress:
            bar = progress.add_task("reading the test split", total=len(variants))
            for index, (path, runtime, reader) in enumerate(variants):
                result = scores(reader, calibration, test, np.random.default_rng(self.seed))
                parameters = sum(parameter.numel() for parameter in TouchNetwork(reader.card).parameters())
                by_batch = {b: t[:, index] for b, t in times.items()}
                entries.append(
                    Entry(
                        f"{reader.card.backbone} {reader.card.input_size} px",
                        runtime,
                        result,
                        path.stat().st_size / 1e6,
                        parameters,
                        {b: 1e3 * float(np.median(t)) / b for b, t in by_batch.items()},
                        {b: float(np.median(t / times[b][:, 0])) for b, t in by_batch.items()},
                    )
                )
                progress.advance(bar)
        numbers = {
            "scene": self.scene,
            "num_touches": len(test.images),
            "threads": self.threads,
            "rounds": self.rounds,
            "seed": self.seed,
            "entries": [asdict(entry) for entry in entries],
        }
        shown = table(entries, len(test.images))
        for name, text in (
            ("frontier.json", json.dumps(numbers, indent=1) + "\n"),
            ("frontier.md", shown.markdown() + "\n"),
        ):
            write_text(self.out / name, text)
        draw_frontier(entries, self.scene, self.out / "frontier.svg")
        print(shown)
        print(f"wrote {self.out}/frontier.md, .json and .svg")

    def _time(
        self, readers: list[TactileReader | TouchClassifier], images: NDArray[np.uint8], batch: int
    ) -> NDArray[np.float64]:
        """Seconds of one batch, by round and reader, ``(rounds, readers)``."""
        images = images[np.arange(batch) % len(images)]  # again from the first, if there are fewer
        calls: list[Callable[[], object]] = [partial(reader.read, images, batch) for reader in readers]
        for call in calls:
            call()
        seconds = np.empty((self.rounds, len(calls)))
        with progress_bar() as progress:
            for number in progress.track(range(self.rounds), description=f"timing, {batch} at once"):
                for column, call in enumerate(calls):
                    started = time.perf_counter()
                    call()
                    seconds[number, column] = time.perf_counter() - started
        return seconds


def trained(state: Path) -> TouchClassifier:
    """The network of a training, of its best epoch where it keeps that."""
    import torch

    from activetouch.perception.classifier import TouchClassifier, TouchNetwork
    from activetouch.perception.learner import with_prefix

    arrays, header = read_tensors(state)
    names = {field.name for field in fields(ClassifierCard)}
    card = card_from({name: value for name, value in header["task"].items() if name in names}, state)
    prefix = "best." if any(name.startswith("best.") for name in arrays) else "model."
    network = TouchNetwork(card)
    network.load_state_dict(with_prefix({name: torch.from_numpy(array) for name, array in arrays.items()}, prefix))
    return TouchClassifier(card, network)


def runtimes(
    classifier: TouchClassifier, image_shape: tuple[int, ...]
) -> Iterator[tuple[str, TactileReader | TouchClassifier]]:
    """A network in every runtime, by name; torch first.

    Args:
        classifier: the network.
        image_shape: ``(H, W)`` or ``(H, W, 3)`` of its images.
    """
    from activetouch.perception.export import export_reader

    yield "torch", classifier
    if which("g++") is not None:  # which compiling needs
        yield "torch, compiled", _compiled(classifier)
    yield "torch, bf16", _to_bfloat16(classifier)
    yield "torch, int8", _to_int8(classifier)
    yield "ONNX Runtime", export_reader(classifier, image_shape)


def _to_bfloat16(classifier: TouchClassifier) -> TouchClassifier:
    """The same classifier with a backbone that computes in bfloat16: faster where the processor has it."""
    import torch

    from activetouch.perception.classifier import TouchClassifier

    network = copy.deepcopy(classifier.network)
    network.backbone.to(torch.bfloat16)
    return TouchClassifier(classifier.card, network)


def _compiled(classifier: TouchClassifier) -> TouchClassifier:
    """The same classifier, compiled by torch for the sizes of batches that it meets."""
    import torch

    from activetouch.perception.classifier import TouchClassifier

    network = cast("TouchNetwork", torch.compile(classifier.network))
    return TouchClassifier(classifier.card, network)


def _to_int8(classifier: TouchClassifier) -> TouchClassifier:
    """The same classifier with linear layers in 8-bit integers, scaled as they run.

    Only measured, not offered: the library has deprecated this function.
    """
    import torch

    from activetouch.perception.classifier import TouchClassifier

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        network = torch.ao.quantization.quantize_dynamic(classifier.network, {torch.nn.Linear}, dtype=torch.qint8)
    return TouchClassifier(classifier.card, network)


def table(entries: Sequence[Entry], num_touches: int) -> Table:
    """Scores, times and sizes of classifiers.

    Args:
        entries: rows of the table; all were timed in the same batches.
        num_touches: touches that they read.
    """
    batches = list(entries[0].milliseconds)
    times = [f"ms per touch, {batch} at once (ratio)" for batch in batches]
    rows = [
        (
            *(f"{e.network}, {e.runtime}", str(e.scores), f"{e.scores.nll:.4f}"),
            *(f"{e.milliseconds[b]:.2f} ({e.ratio[b]:.2f})" for b in batches),
            *(f"{e.megabytes:.1f}", f"{e.parameters / 1e6:.2f} M"),
        )
        for e in entries
    ]
    headings = ["classifier", "accuracy [95 %]", "NLL", *times, "MB", "parameters"]
    return Table(f"{num_touches} touches of unseen objects", headings, rows)


def draw_frontier(entries: Sequence[Entry], scene: str, path: Path) -> None:
    """Draw the error with its interval against the time of a single touch, one colour per runtime.

    Args:
        entries: classifiers.
        scene: name of the scene, for the title.
        path: file to write; the ending decides the format.

    Raises:
        CannotWrite: there is no room, or no permission.
    """
    from matplotlib.ticker import LogLocator, StrMethodFormatter

    from experiments.reporting.style import PALETTE, figure

    with figure((7.0, 4.2), path) as drawn:
        batch = min(entries[0].milliseconds)
        axes = drawn.subplots()
        for runtime, colour in zip(dict.fromkeys(entry.runtime for entry in entries), PALETTE, strict=False):
            some = [entry for entry in entries if entry.runtime == runtime]
            time = np.array([entry.milliseconds[batch] for entry in some])
            draw_errors(axes, time, [entry.scores for entry in some], colour, runtime)
        for network in dict.fromkeys(entry.network for entry in entries):
            some = [entry for entry in entries if entry.network == network]
            left = min(entry.milliseconds[batch] for entry in some)
            top = max(1.0 - entry.scores.interval[0] for entry in some)
            axes.annotate(network, (left, top), xytext=(0, 5), textcoords="offset points")
        axes.set(xlabel=f"milliseconds per touch, {batch} at once", title=f"scene {scene}")
        axes.legend(frameon=False)
        axes.margins(x=0.15, y=0.12)
        axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))


if __name__ == "__main__":
    tyro.cli(Frontier, config=(tyro.conf.OmitSubcommandPrefixes,)).run()
