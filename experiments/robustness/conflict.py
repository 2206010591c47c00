"""How often the conflict test of a sensor fires, and how it tells strangers from known shapes."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import accumulate
from typing import Any

import numpy as np
from numpy.typing import NDArray

from belief.conflict import log_conflict
from belief.observation_model import ArrayModel
from belief.observation_model.rigid_body import joint_model
from belief.observation_model.rigid_body_evidence import RigidBodyEvidence
from belief.out_of_distribution import auroc_interval
from belief.statistics import clopper_pearson_interval
from belief.touch_batch import TouchBatch
from experiments.calibration.sequences import Stops
from experiments.robustness.searches import confidence_at_stops

Floats = NDArray[np.float64]
STREAM = 25
"""Touches of a stream."""
FALSE_ALARMS = 0.02
"""Stated false-alarm rate of the test."""
SO_FAR = ("conflict", "misfit")
"""Scores of an object: the log e-value of all its touches, and their misfit to one known body."""
AFTER = (1, 3, 6)
"""Numbers of touches of an object after which strangers are told from known shapes."""


def tested(model: ArrayModel, touches: TouchBatch) -> tuple[Floats, Floats] | None:
    """What the conflict test says after each touch of S objects; None for a model without a test.

    Returns:
        Log wealth of each strategy, ``(S, n, J)``, and the misfit of all touches so far, ``(S, n)``.
    """
    joint = joint_model(model)
    if joint is None or joint.conflict is None:
        return None
    begin = joint.start()
    wealth, misfits = [], []
    for row in range(len(touches)):
        _, *after = accumulate(touches.sequence(row), RigidBodyEvidence.update, initial=begin)
        tests = [evidence.conflict for evidence in after if evidence.conflict is not None]
        wealth.append([test.log_bets for test in tests])
        misfits.append([test.misfit for test in tests])
    return np.array(wealth), np.array(misfits)


def stream_scores(wealth: Floats, stopped: Stops, seed: int) -> dict[str, Any]:
    """How often the test fires in streams of touches, and what is stated and right where it does not.

    A stream touches objects in random order, each until its stop, or in all poses, and ends with the object that brings
    it to :data:`STREAM` touches. No object is in two streams. Objects that are left over are dropped.

    Args:
        wealth: from :func:`log_bets`, ``(S, n, J)``.
        stopped: stops of the same sequences.
        seed: of the order of objects.

    Returns:
        ``streams``; ``fired``: the fraction in which the test fired, with its 95 % interval; ``touches``: mean number
        before it did; ``quiet``: stops in the other streams (see
        :func:`~experiments.robustness.searches.confidence_at_stops`).
    """
    threshold = np.log(1.0 / FALSE_ALARMS)
    lengths = np.full(len(wealth), wealth.shape[1])
    lengths[stopped.sequences] = stopped.num_touches
    position = {int(row): place for place, row in enumerate(stopped.sequences)}
    until: list[int] = []
    quiet: list[int] = []
    done: list[Floats] = []
    members: list[int] = []
    streams = touches = fired_at = 0
    for row in np.random.default_rng(seed).permutation(len(wealth)).tolist():
        for step in range(int(lengths[row])):
            touches += 1
            if not fired_at and log_conflict([*done, wealth[row, step]]) > threshold:
                fired_at = touches
        done.append(wealth[row, lengths[row] - 1])
        members.append(row)
        if touches < STREAM:
            continue
        streams += 1
        if fired_at:
            until.append(fired_at)
        else:
            quiet += [position[member] for member in members if member in position]
        done, members, fired_at, touches = [], [], 0, 0
    return {
        "streams": streams,
        "fired": [len(until) / streams, *clopper_pearson_interval(len(until), streams)] if streams else None,
        "touches": float(np.mean(until)) if until else None,
        "quiet": confidence_at_stops(stopped.claims[quiet], stopped.correct[quiet], stopped.num_touches[quiet]),
    }


def stranger_scores(known: Mapping[str, Floats], novel: Mapping[str, Floats], after: int) -> dict[str, list[float]]:
    """AUROC of scores of an object after some touches, each with its 95 % interval.

    Args:
        known: scores of known objects: those of :data:`SO_FAR` are of all touches so far; of scores by other names,
            which are of single touches, the mean is taken, ``(S, n)`` each.
        novel: of strangers.
        after: number of touches.
    """
    found = {}
    for name, scores in known.items():
        old, new = (
            some[:, after - 1] if name in SO_FAR else some[:, :after].mean(axis=1) for some in (scores, novel[name])
        )
        found[name] = list(auroc_interval(old, new))
    return found


def alarms(log_e_values: Floats, after: int) -> list[float]:
    """Fraction of objects whose e-value ever exceeded 1 / :data:`FALSE_ALARMS` within some touches, with its interval.

    Args:
        log_e_values: after each touch, ``(S, n)``.
        after: number of touches.
    """
    fired = int((log_e_values[:, :after] > np.log(1.0 / FALSE_ALARMS)).any(axis=1).sum())
    return [fired / len(log_e_values), *clopper_pearson_interval(fired, len(log_e_values))]


def log_e_values(wealth: Floats) -> Floats:
    """Log e-value of each object after each touch, ``(S, n)``, from the wealth of each strategy."""
    largest = wealth.max(axis=2)
    return np.asarray(largest + np.log(np.exp(wealth - largest[..., None]).mean(axis=2)))
