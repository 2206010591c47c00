"""How well the conflict test of an observation model distinguishes objects of unknown shapes from known ones."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, logit

from belief.conflict import log_conflict, log_stranger
from belief.observation_model.model import ArrayModel
from belief.statistics import clopper_pearson_interval
from belief.touch_batch import TouchBatch
from experiments.robustness.touches import ClassifierOutputs

FALSE_ALARMS = 0.02
"""Stated false-alarm rate of the conflict test."""
AFTER = (3, 6)
"""Numbers of touches of an object after which strangers are distinguished from known shapes."""
Floats = NDArray[np.float64]


def e_values(model: ArrayModel, touches: TouchBatch) -> dict[str, Floats] | None:
    """Log e-values after each touch of S objects, ``(S, n)`` by what they speak against; None without a conflict test.

    Args:
        model: the observation model.
        touches: sequences, one for each object.

    Returns:
        ``conflict``: against "these touches come from the world that the model knows"; ``stranger``: against "the
        object has a known shape".
    """
    if model.start().log_bets is None:
        return None
    found = np.zeros((2, len(touches), touches.num_touches))
    for row in range(len(touches)):
        evidence = model.start()
        for step, touch in enumerate(touches.sequence(row)):
            evidence = evidence.update(touch)
            assert evidence.log_bets is not None, "a model with a test"
            found[:, row, step] = log_conflict([evidence.log_bets]), log_stranger(evidence.log_bets)
    return dict(zip(("conflict", "stranger"), found, strict=True))


def alarms(log_e_values: Floats) -> list[float]:
    """Fraction of objects whose e-value ever exceeded 1 / :data:`FALSE_ALARMS`, with its interval."""
    fired = int((log_e_values > np.log(1.0 / FALSE_ALARMS)).any(axis=1).sum())
    return [fired / len(log_e_values), *clopper_pearson_interval(fired, len(log_e_values))]


def auroc_interval(known: Floats, novel: Floats) -> list[float]:
    """P(a novel score exceeds a known one), ties half, with a 95 % interval (DeLong et al. 1988, on the logit scale).

    Args:
        known: scores of two or more known objects, ``(n,)``.
        novel: scores of two or more novel ones, ``(m,)``.
    """
    wins = (novel[:, None] > known) + 0.5 * (novel[:, None] == known)
    value, fewer = float(wins.mean()), min(wins.shape)
    variance = wins.mean(axis=1).var(ddof=1) / len(novel) + wins.mean(axis=0).var(ddof=1) / len(known)
    if variance < 1e-20:
        return [value, *clopper_pearson_interval(round(value * fewer), fewer)]
    reach = 1.96 * np.sqrt(variance) / (value * (1.0 - value))
    return [value, *expit(logit(value) + np.array([-reach, reach])).tolist()]


def stranger_scores(
    known: ClassifierOutputs, novel: ClassifierOutputs, model: ArrayModel, novel_labels: Sequence[str], seed: int
) -> dict[str, dict[str, Any]]:
    """How well the e-values of a model distinguish unknown from known shapes, by unknown shape and for all together.

    Args:
        known: outputs for objects of known shapes.
        novel: outputs for objects of unknown shapes.
        model: the observation model, with a conflict test.
        novel_labels: names of the unknown shapes.
        seed: of the order of poses.

    Returns:
        Per shape ``num_objects``; ``after``: by number of touches, ``auroc`` of each e-value with its 95 % interval,
        and the fractions of known objects and of strangers for which the test fires as ``false_alarms`` and
        ``alarms``; ``taken_for``, the most frequently predicted known shape, and its ``share``. Empty for a
        model without a conflict test.
    """
    old, new = (e_values(model, outputs.shuffled(seed)) for outputs in (known, novel))
    if old is None or new is None:
        return {}
    taken = novel.logits.argmax(axis=2)
    every = {label: novel.shapes == k for k, label in enumerate(novel_labels)} | {"all": novel.shapes >= 0}
    results = {}
    for label, rows in every.items():
        counts = np.bincount(taken[rows].ravel(), minlength=len(model.shape_labels))
        results[label] = {
            "num_objects": int(rows.sum()),
            "after": {
                str(number): {
                    "auroc": {
                        score: auroc_interval(old[score][:, number - 1], new[score][rows, number - 1]) for score in old
                    },
                    "false_alarms": alarms(old["conflict"][:, :number]),
                    "alarms": alarms(new["conflict"][rows, :number]),
                }
                for number in AFTER
                if number <= known.logits.shape[1]
            },
            "taken_for": model.shape_labels[int(counts.argmax())],
            "share": float(counts.max() / counts.sum()),
        }
    return results
