"""Quality of readers of several touches, in numbers, words and tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from experiments.bayes_error.estimator import words
from experiments.bayes_error.simulation import log_loss
from experiments.reporting.tables import Table
from experiments.sensor.after_touches import after_touches

Floats = NDArray[np.float64]


def quality(log_probs: Floats, shapes: NDArray[np.int64], touches: int, seed: int) -> dict[str, Any]:
    """Accuracy, NLL and calibration of a reader, with 95 % intervals over objects.

    Args:
        log_probs: log posteriors of objects, ``(M, K)``.
        shapes: true shapes, ``(M,)``.
        touches: of each object; only noted.
        seed: of the bootstrap.
    """
    found = after_touches(log_probs, shapes, np.arange(len(shapes)), touches, seed)
    return {
        "touches": touches,
        "accuracy": {"value": found.accuracy, "interval": found.accuracy_interval},
        "nll": {"value": found.nll, "interval": found.nll_interval},
        "stated": found.stated,
        "stated_minus_accuracy": {"value": found.gap, "interval": found.gap_interval},
    }


def brief(log_probs: Floats, shapes: NDArray[np.int64]) -> dict[str, list[float]]:
    """Accuracy and NLL by number of touches, from log posteriors ``(M, T, K)``."""
    after_each = np.moveaxis(log_probs, 1, 0)
    return {
        "accuracy": [float(np.mean(logs.argmax(axis=1) == shapes)) for logs in after_each],
        "nll": [float(log_loss(logs, shapes).mean()) for logs in after_each],
    }


def sentences(numbers: dict[str, Any]) -> list[str]:
    """Method and main results."""
    joint, independent = (numbers["readers"][name][-1] for name in ("joint", "independent"))
    return [
        "Given shape, orientation and size, touches of an object are independent. The joint reader applies Bayes' rule "
        f"over {numbers['bodies']} simulated bodies of every shape, with {numbers['images_per_body_and_pose']} images "
        "of each in every pose; the independent reader multiplies the evidence of single touches of the same bank.",
        f"{numbers['objects']} unseen objects, each touched once in every pose, in random order. After "
        f"{joint['touches']} touches the joint reader has accuracy {words(joint['accuracy'])} and NLL "
        f"{words(joint['nll'])}, the independent reader {words(independent['accuracy'])} and "
        f"{words(independent['nll'])}.",
        "A finite bank makes the joint reader worse and too confident; the table by size of the bank shows whether it "
        "is large enough, stated minus accuracy whether the joint reader is calibrated.",
    ]


def tables(touches: tuple[int, ...], numbers: dict[str, Any]) -> list[Table]:
    """One table for each measure, with a row for each number of touches and a column for each reader."""
    measures = {
        "accuracy": ("Accuracy", ""),
        "nll": ("NLL [nats]", ""),
        "stated_minus_accuracy": ("Stated confidence minus accuracy", "+"),
    }
    found = [
        by_touches(
            title,
            touches,
            {name: [words(row[measure], sign) for row in rows] for name, rows in numbers["readers"].items()},
        )
        for measure, (title, sign) in measures.items()
    ]
    gaps = {name: [words(entry, "+") for entry in rows] for name, rows in numbers["differences"].items()}
    found.append(by_touches("NLL minus that of the joint reader, same objects", touches, gaps))
    curve = {
        f"{row['bodies']}": [f"{a:.4f}, {n:.4f}" for a, n in zip(row["accuracy"], row["nll"], strict=True)]
        for row in numbers["curve"]
    }
    return [*found, by_touches("Accuracy and NLL of the joint reader, by bodies per shape", touches, curve)]


def by_touches(title: str, touches: Sequence[int], columns: Mapping[str, list[str]]) -> Table:
    """A table with a row for each number of touches."""
    rows = [(str(n), *cells) for n, cells in zip(touches, zip(*columns.values(), strict=True), strict=True)]
    return Table(title, ("touches", *columns), rows)
