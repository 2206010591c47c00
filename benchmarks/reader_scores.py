"""Accuracy of readers on touches of objects that they were not trained on, and its figure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from numpy.typing import NDArray

from activetouch.data.dataset import TouchSet
from activetouch.perception.reader import TactileReader
from belief.calibration import TemperatureScaling
from belief.metrics import negative_log_likelihood
from experiments.sensor.scores import accuracy_of_objects

if TYPE_CHECKING:
    from activetouch.perception.classifier import TouchClassifier


@dataclass(frozen=True)
class Scores:
    """Of single touches.

    Attributes:
        accuracy: share of the test touches read correctly.
        interval: of the accuracy, 95 %, as of :func:`accuracy_of_objects`.
        nll: of the test touches, after temperature scaling on the calibration split [nats].
    """

    accuracy: float
    interval: tuple[float, float]
    nll: float

    def __str__(self) -> str:
        low, high = self.interval
        return f"{self.accuracy:.4f} [{low:.4f}, {high:.4f}]"


def scores(
    reader: TactileReader | TouchClassifier, calibration: TouchSet, test: TouchSet, rng: np.random.Generator
) -> Scores:
    """Scores on a test split, with a temperature from the calibration split; ``rng`` is that of the interval."""
    known, read = reader.read(calibration.images, 256), reader.read(test.images, 256)
    scaling = TemperatureScaling().fit(known.logits, calibration.shapes)
    accuracy, low, high = accuracy_of_objects(read.labels == test.shapes, test.object_ids, rng)
    return Scores(accuracy, (low, high), negative_log_likelihood(scaling.predict_proba(read.logits), test.shapes))


def draw_errors(
    axes: Axes, x: NDArray[Any], scores: Sequence[Scores], colour: str, label: str = ""
) -> NDArray[np.float64]:
    """Draw errors as dots with intervals on logarithmic axes.

    Args:
        axes: to draw on.
        x: positions, ``(N,)``.
        scores: N of them.
        colour: of dots and intervals.
        label: in the legend.

    Returns:
        The errors, ``(N,)``.
    """
    error = np.array([1.0 - score.accuracy for score in scores])
    low, high = (np.array([1.0 - score.interval[side] for score in scores]) for side in (1, 0))
    reach = [error - low, high - error]
    axes.errorbar(x, error, reach, fmt="o", color=colour, elinewidth=1, capsize=2, alpha=0.8, label=label)
    axes.set(xscale="log", yscale="log", ylabel="single touches misread")
    axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 3, 5)))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda share, _: f"{100 * share:g} %"))
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_minor_formatter(NullFormatter())
    axes.grid(alpha=0.25, which="both")
    return error
