"""Estimator for images of few taxels: Bayes' rule with likelihoods from :mod:`experiments.bayes_error.image_bank`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from activetouch.pressing.press import Press, Quasistatic
from experiments.bayes_error.estimator import Findings, LimitStudy, paired_difference, share, words
from experiments.bayes_error.image_bank import (
    IMAGES_PER_SLICE,
    SensorNoise,
    ideal_symmetry,
    log_evidence_of_slice,
    log_posterior,
    pool,
)
from experiments.command_line.arguments import Count, CountOrNone
from experiments.parallel import run_tasks
from experiments.reporting.tables import Table

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class SimulatedBayes:
    """Estimator that applies Bayes' rule with a bank of ideal images for every shape."""

    bank: Count = 100_000
    """Ideal images per shape, in steps of 1000; all their equally likely rotations and reflections are added."""
    checked: CountOrNone = 8_000
    """Ideal images per shape of a second bank that is pressed as the scene presses, in steps of 1000, at most as many
    as in the first; 0 for none."""

    def measure(self, study: LimitStudy) -> Findings:
        """See :class:`experiments.bayes_error.estimator.Estimator`."""
        scene, shapes = study.scene, study.shapes
        noise = SensorNoise.of(scene.faults, scene.image_shape[0])  # raises before anything is pressed
        readings = study.read()
        classifier = study.classify(readings)
        evidence = self._evidence(study, noise, readings, Quasistatic(), self.bank)  # (S, N, K)
        sizes = [size for part in (8, 4, 2, 1) if (size := len(evidence) // part)]
        curve = [summary(log_posterior(pool(evidence[:size])), shapes, size) for size in dict.fromkeys(sizes)]
        best = log_posterior(pool(evidence))
        right, known = best.argmax(axis=1) == shapes, classifier.argmax(axis=1) == shapes
        numbers: dict[str, Any] = {
            "estimator": "simulated Bayes",
            "taxels": len(noise.live),
            "curve": curve,
            "limit": share(right),
            "classifier": {**share(known), "nll": nll(classifier, shapes)},
            "difference": paired_difference(right, known, study.seed),
            "nll_difference": paired_difference(log_loss(best, shapes), log_loss(classifier, shapes), study.seed),
            "same_guess": float(np.mean(best.argmax(axis=1) == classifier.argmax(axis=1))),
            "limit_by_shape": by_shape(right, shapes, scene.shape_labels),
            "classifier_by_shape": by_shape(known, shapes, scene.shape_labels),
        }
        if self.checked:
            pressed = self._evidence(study, noise, readings, scene.press_model, min(self.checked, self.bank))
            first, second = (
                log_posterior(pool(part)).argmax(axis=1) == shapes for part in (pressed, evidence[: len(pressed)])
            )
            numbers["pressed_as_the_scene_does"] = {
                "images_per_shape": len(pressed) * IMAGES_PER_SLICE,
                **share(first),
            }
            numbers["pressed_against_quasistatic"] = paired_difference(first, second, study.seed)
        title = "Bayes-optimal accuracy of one touch, by simulation"
        return Findings(title, self._say(study, numbers), _tables(numbers), numbers)

    def _evidence(
        self, study: LimitStudy, noise: SensorNoise, readings: NDArray[np.uint8], press: Press, images: int
    ) -> Floats:
        """Log likelihoods by slice of the bank, touch and shape, ``(S, N, K)``."""
        scene = study.scene
        num_slices = max(1, images // IMAGES_PER_SLICE)
        tasks: list[Callable[[], tuple[int, int, Floats]]] = [
            partial(
                log_evidence_of_slice, replace(scene, press_model=press), noise, readings, shape, number, study.seed
            )
            for number in range(num_slices)
            for shape in range(len(scene.shapes))
        ]
        evidence = np.empty((num_slices, len(readings), len(scene.shapes)))
        for shape, number, values in run_tasks(tasks, study.jobs, f"bank of ideal images, {type(press).__name__}"):
            evidence[number, :, shape] = values
        return evidence

    def _say(self, study: LimitStudy, numbers: dict[str, Any]) -> list[str]:
        edge, last, views = numbers["taxels"], numbers["curve"][-1], ideal_symmetry(study.scene)
        lines = [
            f"Why this estimator: the images have {edge} × {edge} taxels and the sensor's faults have a closed-form "
            "likelihood, so the best possible reader can be computed: Bayes' rule, with the likelihood of every shape "
            f"averaged over {last['images_per_shape']} ideal images from the simulator and all that are equally likely "
            f"({views}).",
            f"{study.touches} held-out touches, each of another object, seed {study.seed}. The accuracy is "
            f"{words(numbers['limit'])}; the expected accuracy under its own posterior is "
            f"{last['expected_accuracy']:.4f}. A finite bank makes the first too low and the second too high, so the "
            "limit lies between them, up to the sampling of touches.",
            f"The classifier has accuracy {words(numbers['classifier'])} on the same touches; Bayes minus classifier "
            f"{words(numbers['difference'], '+')}, NLL {last['nll']:.4f} against {numbers['classifier']['nll']:.4f} "
            f"({words(numbers['nll_difference'], '+')}). Both guess the same shape for "
            f"{numbers['same_guess']:.1%} of the touches.",
        ]
        if "pressed_against_quasistatic" in numbers:
            lines.append(
                "The bank is pressed quasistatically, the touches as the scene presses. A bank of "
                f"{numbers['pressed_as_the_scene_does']['images_per_shape']} ideal images per shape, pressed as the "
                "scene presses, differs in accuracy from a quasistatic bank of that size by "
                f"{words(numbers['pressed_against_quasistatic'], '+')}."
            )
        return lines


def summary(log_probs: Floats, shapes: NDArray[np.int64], num_slices: int) -> dict[str, float]:
    """Accuracy, expected accuracy and NLL of a bank.

    Args:
        log_probs: log posteriors, ``(N, K)``.
        shapes: true shapes, ``(N,)``.
        num_slices: size of the bank, in slices.
    """
    return {
        "images_per_shape": num_slices * IMAGES_PER_SLICE,
        "accuracy": float(np.mean(log_probs.argmax(axis=1) == shapes)),
        "expected_accuracy": float(np.exp(log_probs.max(axis=1)).mean()),
        "nll": nll(log_probs, shapes),
    }


def log_loss(log_probs: Floats, shapes: NDArray[np.int64]) -> Floats:
    """Negative log probability of the true shape, for each touch [nats]."""
    return -log_probs[np.arange(len(shapes)), shapes]


def nll(log_probs: Floats, shapes: NDArray[np.int64]) -> float:
    """Mean of :func:`log_loss`."""
    return float(log_loss(log_probs, shapes).mean())


def by_shape(right: NDArray[np.bool_], shapes: NDArray[np.int64], labels: tuple[str, ...]) -> dict[str, float]:
    """Accuracy for the touches of each shape."""
    return {label: float(right[shapes == k].mean()) for k, label in enumerate(labels)}


def _tables(numbers: dict[str, Any]) -> list[Table]:
    known = numbers["classifier"]
    rows = [
        (
            f"{row['images_per_shape']} images per shape",
            f"{row['accuracy']:.4f}",
            f"{row['expected_accuracy']:.4f}",
            f"{row['nll']:.4f}",
        )
        for row in numbers["curve"]
    ]
    rows.append(("classifier", f"{known['value']:.4f}", "", f"{known['nll']:.4f}"))
    shapes = [
        (label, f"{limit:.4f}", f"{numbers['classifier_by_shape'][label]:.4f}")
        for label, limit in numbers["limit_by_shape"].items()
    ]
    return [
        Table("Accuracy by size of the bank", ("reader", "accuracy", "expected", "NLL"), rows),
        Table("Accuracy by shape", ("shape", "limit", "classifier"), shapes),
    ]
