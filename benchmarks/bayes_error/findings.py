"""Results of an estimator of the least possible error, in numbers, sentences and tables."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from belief.files import write_text
from belief.statistics import cluster_bootstrap, paired_bootstrap
from belief.table import Table

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Findings:
    """Results of an estimator.

    Attributes:
        title: one line.
        sentences: method, reason for it, and interpretation.
        tables: tables.
        numbers: all results, for programs.
    """

    title: str
    sentences: Sequence[str]
    tables: Sequence[Table]
    numbers: dict[str, Any]

    def write(self, folder: Path, identity: dict[str, Any]) -> None:
        """Write ``limit.json`` and ``limit.md``."""
        write_text(folder / "limit.json", json.dumps({**identity, **self.numbers}, indent=1) + "\n")
        text = "\n\n".join([f"# {self.title}", *self.sentences, *(table.markdown() for table in self.tables)])
        write_text(folder / "limit.md", text + "\n")


def chunks(count: int, size: int) -> list[range]:
    """The numbers below ``count`` in order, in blocks of ``size``."""
    return [range(first, min(first + size, count)) for first in range(0, count, size)]


def log_loss(log_probs: Floats, shapes: NDArray[np.int64]) -> Floats:
    """Negative log probability of the true shape [nats], ``(N,)``, from log posteriors ``(N, K)``."""
    return -log_probs[np.arange(len(shapes)), shapes]


def paired_difference(first: NDArray[Any], second: NDArray[Any], seed: int) -> dict[str, Any]:
    """Mean of ``first - second`` over the same touches, with its 95 % bootstrap interval."""
    mean, low, high = paired_bootstrap(first.astype(float), second.astype(float), np.random.default_rng(seed))
    return {"value": mean, "interval": (low, high)}


def mean_of_objects(values: NDArray[Any], objects: NDArray[np.int64], seed: int) -> dict[str, Any]:
    """Mean of the values of touches, with its 95 % interval over objects."""
    mean, low, high = cluster_bootstrap(values.astype(float), objects, np.random.default_rng(seed))
    return {"value": mean, "interval": (low, high)}


def words(entry: dict[str, Any], sign: str = "") -> str:
    """A value and its interval as text; ``sign="+"`` shows the sign of positive values."""
    low, high = entry["interval"]
    return f"{entry['value']:{sign}.4f} [{low:{sign}.4f}, {high:{sign}.4f}]"


def by_touches(title: str, touches: Sequence[int], columns: Mapping[str, list[str]]) -> Table:
    """A table with a row for each number of touches."""
    rows = [(str(n), *cells) for n, cells in zip(touches, zip(*columns.values(), strict=True), strict=True)]
    return Table(title, ("touches", *columns), rows)
