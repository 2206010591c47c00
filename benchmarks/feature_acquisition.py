"""Features with a cost: two synthetic tasks of AFABench (arXiv 2508.14734), learned from rows and asked one by one.

    python -m benchmarks.feature_acquisition --train 14000 --test 2000
    python -m benchmarks.feature_acquisition --train 600 --deviation 0.3

CUBE has 20 features and eight classes. Class k shows its three bits, with a standard deviation of 0.1, in the features
k, k + 1 and k + 2; all others are noise around 0.5 with 0.3. CUBE-NM has five contexts, a noisy code of the context,
which is one action, and ten features for each context: only those of the own context show the class. The context alone
tells nothing about the class, so that a choice by the gain of one action begins with something else.

The generator is written from the paper's description. It agrees with the classes CubeDataset and CubeNMDataset of
github.com/Linusaronsson/AFA-Benchmark (a07c8a3b), whose deviation is 0.1 as well; that repository's experiments set it
to 0.3, and learn from 600 rows: the second command. "exact" is the share of right answers with the densities of the
generator and all features, the most that any choice can reach.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from belief.table import Table
from planners import ActiveClassification

BITS = np.array([[k & 1, k >> 1 & 1, k >> 2 & 1] for k in range(8)], np.float64)
NOISE, CODE, CONTEXTS = 0.3, 0.1, 5
GROUPS = [tuple(range(CONTEXTS)), *((CONTEXTS + place,) for place in range(10 * CONTEXTS))]
Rows = tuple[NDArray[np.float64], NDArray[np.int64]]


def cube(number: int, shown: float, rng: np.random.Generator) -> Rows:
    """Rows ``(n, 20)`` and classes ``(n,)`` of CUBE, whose bits have the standard deviation ``shown``."""
    classes, rows = rng.integers(8, size=number), rng.normal(0.5, NOISE, (number, 20))
    own = classes[:, None] + np.arange(3)
    rows[np.arange(number)[:, None], own] = BITS[classes] + rng.normal(0.0, shown, (number, 3))
    return rows, classes


def cube_nm(number: int, shown: float, rng: np.random.Generator) -> Rows:
    """Rows ``(n, 55)`` and classes ``(n,)`` of CUBE-NM."""
    classes, contexts = rng.integers(8, size=number), rng.integers(CONTEXTS, size=number)
    blocks = rng.normal(0.5, NOISE, (number, CONTEXTS, 10))
    own = classes[:, None] + np.arange(3)
    blocks[np.arange(number)[:, None], contexts[:, None], own] = BITS[classes] + rng.normal(0.0, shown, (number, 3))
    code = np.eye(CONTEXTS)[contexts] + rng.normal(0.0, CODE, (number, CONTEXTS))
    return np.hstack([code, blocks.reshape(number, -1)]), classes


def exact(rows: NDArray[np.float64], classes: NDArray[np.int64], shown: float) -> float:
    """Share of right answers with all features and the densities of the generator."""
    number = len(rows)
    code, blocks = (rows[:, :CONTEXTS], rows[:, CONTEXTS:]) if rows.shape[1] > 20 else (np.zeros((number, 0)), rows)
    blocks = blocks.reshape(number, max(code.shape[1], 1), -1)
    scores = np.zeros((number, 8, blocks.shape[1]))
    for k in range(8):
        own = blocks[:, :, k : k + 3]
        scores[:, k] = (norm.logpdf(own, BITS[k], shown) - norm.logpdf(own, 0.5, NOISE)).sum(axis=2)
    for context in range(code.shape[1]):
        scores[:, :, context] += norm.logpdf(code, np.eye(CONTEXTS)[context], CODE).sum(axis=1)[:, None]
    return float((np.logaddexp.reduce(scores, axis=2).argmax(axis=1) == classes).mean())


def main() -> None:
    """Learn both tasks, classify other rows, and print what was right and stated after some features."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--train", type=int, default=14_000, help="rows to learn from")
    parser.add_argument("--test", type=int, default=2_000, help="rows to classify")
    parser.add_argument("--deviation", type=float, default=0.1, help="of the bits")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    rows = []
    for name, draw, groups, depth, after in (
        ("CUBE", cube, None, 2, (3, 5, 7)),
        ("CUBE-NM", cube_nm, GROUPS, 2, (5, 7)),
    ):
        rng = np.random.default_rng(given.seed)
        (known, labels), (cases, truth) = (draw(count, given.deviation, rng) for count in (given.train, given.test))
        start = time.process_time()
        task = ActiveClassification.from_cases(
            known, labels, groups=groups, max_actions=max(after), stop=np.inf, depth=depth
        )
        learned, start = time.process_time() - start, time.process_time()
        found = task.evaluate(cases, truth)
        spent = (time.process_time() - start) / (2 * len(cases))
        rows.append(
            (
                f"{name}: exact, all features {exact(cases, truth, given.deviation):.3f}; "
                f"{task.model.weights.shape[1]} contexts, learned in {learned:.0f} s, {1e3 * spent:.0f} ms a case",
            )
        )
        for number in after:
            right, stated = found.after(number)
            rows.append((name, number, right, stated, found.after(number, "random")[0]))
    columns = ["task", ("features", "d"), ("right", ".3f"), ("stated", ".3f"), ("random order", ".3f")]
    print(Table("", columns, rows, f"{given.train} rows to learn from, {given.test} others classified."))


if __name__ == "__main__":
    main()
