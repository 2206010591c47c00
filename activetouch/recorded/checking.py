"""Checks of recorded touches: whether searches can be played on them, and what would tell the label without a touch."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from activetouch.errors import BadRecording
from activetouch.recorded.odd_sessions import odd_sessions
from activetouch.recorded.reader import LinearDiscriminants, label_logits, learn
from activetouch.recorded.touches import TASKS, RecordedTouches, Split, splits_of
from belief.naming import few
from belief.validation import Floats

_OBJECTS = 3  # objects of a category or shape: to learn from, to calibrate on and to test on
_CONTROL, _SINGLE = 0.5, 0.75  # shares of what all features tell beyond a guess, from which a warning is due
_UNLIKE, _STEADY = 3.0, 0.1  # factor on what nine of ten features tell; variance within objects, of that between them
_CHANCE = 4.0  # standard errors above a guess, so that the best of many features is no warning by chance
_GUESSED = 2.0  # standard errors above a guess, below which all features tell nothing
_SHOWN = 3  # single features


@dataclass(frozen=True, eq=False)
class Leaks:
    """Accuracy of one held-out touch: by a guess, all features, each control, and each feature alone, ``(F,)``.

    ``within (F,)`` is the variance of features within objects as a share of that between them. ``least`` are four
    limits: the accuracies from which a control, and a single feature, tell too much; the one from which a feature that
    hardly varies within objects is suspicious; and the one from which all features tell more than a guess.
    """

    task: str
    guess: float
    least: tuple[float, ...]
    groups: dict[str, float]
    single: Floats
    within: Floats
    names: tuple[str, ...]

    @classmethod
    def of(cls, touches: RecordedTouches, splits: list[Split]) -> Leaks:
        """The leaks of a set; its readers learn from the touches of the splits, and read the same ones as there."""
        right = dict.fromkeys(("all features", *touches.controls), 0.0)
        single, number, seen = np.zeros(touches.features.shape[1]), 0, np.zeros(len(touches.label_names))
        kind = LinearDiscriminants(0.3)
        for split in splits:
            known = np.concatenate([split.train, split.calibration])
            labels, actions = touches.labels[split.test], touches.actions[split.test]
            number, seen = number + len(labels), seen + np.bincount(labels, minlength=len(seen))
            for name, rows in zip(right, (touches.features, *touches.controls.values()), strict=True):
                learned = learn(touches, rows, known, [kind] * touches.num_actions)
                right[name] += float((label_logits(learned, rows[split.test], actions).argmax(axis=1) == labels).sum())
            for action in np.unique(actions).tolist():
                here = known[touches.actions[known] == action]
                single += _right_alone(touches, here, split.test[actions == action])
        guess = float(seen.max() / number)
        groups = {name: count / number for name, count in right.items()}
        error = float(np.sqrt(guess * (1.0 - guess) / number))
        single, gain = single / number, groups["all features"] - guess
        unlike = _UNLIKE * (float(np.quantile(single, 0.9)) - guess)
        gains = [max(share, _CHANCE * error) for share in (_CONTROL * gain, _SINGLE * gain, unlike)]
        least = tuple(guess + share for share in (*gains, _GUESSED * error))
        names = touches.feature_names or tuple(f"feature {i}" for i in range(len(single)))
        return cls(touches.task, guess, least, groups, single, _within(touches), names)

    def summary(self) -> str:
        """A sentence of the accuracies: of all features, of controls and of the best single features."""
        best = np.argsort(-self.single, kind="stable")[:_SHOWN].tolist()
        told = [f"{name} {share:.3f}" for name, share in self.groups.items()]
        alone = ", ".join(f"{self.names[i]} {self.single[i]:.3f}" for i in best)
        lacking = "" if "untouched" in self.groups else "; the set has no columns from where nothing was touched"
        return (
            f"One touch names one of the {self.task} rightly in: {', '.join(told)}, a guess {self.guess:.3f}{lacking}. "
            f"The best single features alone: {alone}."
        )

    @property
    def is_guess(self) -> bool:
        """Whether all features tell no more than a guess, in enough touches to show it."""
        return self.groups["all features"] < self.least[3] <= 1.0

    def warnings(self) -> tuple[str, ...]:
        """Sentences about controls and single features that tell much of what all features tell."""
        found = [
            f"the control {name!r} alone names one of the {self.task} in {share:.3f}, all features in "
            f"{self.groups['all features']:.3f}: these results do not show that a touch is read"
            for name, share in self.groups.items()
            if name != "all features" and share >= self.least[name != "untouched"]
        ]
        is_odd = (self.single >= self.least[2]) & (self.within <= _STEADY) | (self.single >= self.least[1])
        best = [i for i in np.argsort(-self.single, kind="stable").tolist() if is_odd[i]]
        if best and len(self.single) > 1:
            listed = few([f"{self.names[i]} {self.single[i]:.3f} ({self.within[i]:.2g})" for i in best], 6)
            found.append(
                f"single features alone name one of the {self.task} in {listed}, all in "
                f"{self.groups['all features']:.3f}; in brackets their variance within objects, as a share of that "
                "between them. If they were not measured in the touch (time, temperature, place, a label), leave them "
                "out, or name them untouched:NAME, which makes them a control"
            )
        return tuple(found)


def _right_alone(touches: RecordedTouches, known: NDArray[np.int64], tested: NDArray[np.int64]) -> Floats:
    """How many tested touches of an action each feature names rightly, ``(F,)``, by the nearest mean of an object."""
    objects, number, counts = np.unique(touches.objects[known], return_inverse=True, return_counts=True)
    label_of = touches.labels[known][np.unique(number, return_index=True)[1]]
    means = np.zeros((len(objects), touches.features.shape[1]))
    np.add.at(means, number, touches.features[known] / counts[number, None])
    order = means.argsort(axis=0)
    means = np.take_along_axis(means, order, axis=0)
    middles = means[:-1] / 2 + means[1:] / 2
    rows, truth = touches.features[tested], touches.labels[tested]
    found = [(label_of[order[middles[:, i].searchsorted(rows[:, i]), i]] == truth).sum() for i in range(rows.shape[1])]
    return np.array(found, np.float64)


def _within(touches: RecordedTouches) -> Floats:
    """Variance of each feature within objects, as a share of that between them with one action, ``(F,)``."""
    rows = touches.features / np.maximum(np.abs(touches.features).max(axis=0), np.finfo(float).tiny)
    rows = rows - _means(rows, touches.actions)
    means = _means(rows, touches.objects * touches.num_actions + touches.actions)
    within, between = ((rows - means) ** 2).mean(axis=0), (means**2).mean(axis=0)
    return np.asarray(np.minimum(within / np.maximum(between, 1e-9 * within + 1e-300), 1e9))


def _means(rows: Floats, groups: NDArray[np.int64]) -> Floats:
    """Mean row of the group of each row, ``(n, F)``."""
    _, number, counts = np.unique(groups, return_inverse=True, return_counts=True)
    means = np.zeros((len(counts), rows.shape[1]))
    np.add.at(means, number, rows / counts[number, None])
    return means[number]


def check_recorded(touches: RecordedTouches) -> tuple[str, ...]:
    """Check that a set can be split, read and searched in, and return remarks about what weakens its results.

    Raises:
        BadRecording: there are fewer than two labels, one has too few objects, or an object has too few sessions; the
            message says which and what is needed.

    >>> rows = np.arange(12.0).reshape(12, 1) % 5
    >>> mugs = RecordedTouches(rows, [0] * 12, [0, 1] * 6, np.arange(12) // 2, ("press",), ("mug", "ball"))
    >>> check_recorded(mugs)
    ('7 touches have exactly the features of an earlier touch; copies leak from training into tests',)
    """
    if len(touches.label_names) < 2:
        raise BadRecording(
            f"a search needs at least two different {touches.task}, there is {list(touches.label_names)}"
        )
    if scarce := _scarce(touches):
        raise BadRecording(
            f"{touches.task} need at least {_OBJECTS} objects of each, to learn from, to calibrate on and to test on; "
            f"there are {scarce}; --drop leaves these out"
        )
    counts = touches.session_counts()
    known = np.unique(touches.objects)
    if touches.task == TASKS[0] and len(lacking := known[counts[known].max(axis=1) < 2]):
        raise BadRecording(
            f"{len(lacking)} of {len(known)} objects have too few sessions: {_listed(touches, lacking)}; objects need "
            "at least 2 with some action, one to learn from and one to test on. --drop leaves these out; --task "
            "categories names objects that were not learned from"
        )
    remarks = []
    if len(out := _incomplete(touches)):
        remarks.append(
            f"{len(out)} of {len(known)} objects lack sessions: {_listed(touches, out)}. They are touched with the "
            "actions that they have; --drop leaves these objects out"
        )
    copies = len(touches.features) - len(np.unique(np.column_stack([touches.features, touches.actions]), axis=0))
    if copies:
        remarks.append(
            f"{copies} touches have exactly the features of an earlier touch; copies leak from training into tests"
        )
    remarks += [*suspicious_features(touches), *odd_sessions(touches)]
    leaks = Leaks.of(touches, splits_of(touches, 5))
    if leaks.is_guess:
        remarks.append(
            f"one held-out touch names one of the {touches.task} in {leaks.groups['all features']:.3f}, a guess in "
            f"{leaks.guess:.3f}: discriminants find nothing in these features. Check that they belong to the objects "
            "of their rows, and record more sessions"
        )
    return (*remarks, *leaks.warnings())


def without_incomplete(touches: RecordedTouches) -> tuple[RecordedTouches, tuple[str, ...]]:
    """The touches of objects with all actions and of labels with enough objects, and sentences about the others."""
    notes = []
    if len(out := _incomplete(touches)):
        if len(out) == len(np.unique(touches.objects)):
            raise BadRecording(
                f"no object has enough sessions of every action: {_listed(touches, out)}; without --drop, objects are "
                "touched with the actions that they have"
            )
        notes.append(f"{len(out)} objects are left out as they lack sessions: {_listed(touches, out)}")
        touches = touches.without(out)
    if scarce := _scarce(touches):
        if len(scarce) == len(touches.label_names):
            raise BadRecording(f"none of the {touches.task} has {_OBJECTS} objects; there are {scarce}")
        notes.append(f"{len(scarce)} {touches.task} are left out as they have too few objects: {scarce}")
        touches = touches.without(np.flatnonzero(np.isin(touches.kinds[touches.task], list(scarce))))
    return touches, tuple(notes)


def _incomplete(touches: RecordedTouches) -> NDArray[np.int64]:
    """Objects with fewer sessions of an action than a test needs."""
    known = np.unique(touches.objects)
    needed = 2 if touches.task == TASKS[0] else 1
    return np.asarray(known[touches.session_counts()[known].min(axis=1) < needed])


def _scarce(touches: RecordedTouches) -> dict[str, int]:
    """Categories or shapes with too few objects, and their numbers of objects."""
    if touches.task == TASKS[0]:
        return {}
    owners = np.unique(np.stack([touches.labels, touches.objects]), axis=1)[0]
    counts = zip(touches.label_names, np.bincount(owners, minlength=len(touches.label_names)).tolist(), strict=True)
    return {name: count for name, count in counts if count < _OBJECTS}


def _listed(touches: RecordedTouches, objects: NDArray[np.int64]) -> str:
    counts, needed = touches.session_counts(), 2 if touches.task == TASKS[0] else 1
    parts = [
        [f"{counts[i, a]} of {touches.action_names[a]}" for a in np.flatnonzero(counts[i] < needed)] for i in objects
    ]
    named = [f"{touches.object_names[i]} ({few(part, 4)})" for i, part in zip(objects, parts, strict=True)]
    return few(named, 12).replace("), ", "); ")


def suspicious_features(touches: RecordedTouches) -> tuple[str, ...]:
    """Sentences about features that name the object of a touch, or number its session or row.

    >>> rows = [[0.1, 7.0], [0.3, 7.0], [0.2, 8.0], [0.4, 8.0]]
    >>> mugs = RecordedTouches(rows, [0] * 4, [0, 0, 1, 1], [0, 1] * 2, ("press",), ("mug", "cup"))
    >>> suspicious_features(mugs)  # doctest: +ELLIPSIS
    ('these features name the object: feature 1. They are equal in all touches of an object and differ between...',)
    """
    steps = np.diff(touches.features, axis=0)
    counts = (steps == steps[:1]).all(axis=0) & (steps[:1] != 0.0).any(axis=0) & (touches.num_touches > 2)
    by_object, by_session = (_tells(touches.features, groups) for groups in (touches.objects, touches.sessions))
    same = "are equal in all touches of"
    found = (
        ("name the object", by_object, f"{same} an object and differ between objects"),
        ("number the session", by_session, f"{same} a session and differ between sessions"),
        ("count the rows", counts, "grow by the same in every row"),
    )
    names = touches.feature_names or [f"feature {i}" for i in range(touches.features.shape[1])]
    return tuple(
        f"these features {what}: {few([names[i] for i in np.flatnonzero(which)], 12)}. They {why}; leave out what was "
        "not measured in the touch"
        for what, which, why in found
        if which.any()
    )


def _tells(features: Floats, groups: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Whether each feature is equal within every group and differs between groups of two rows or more on average."""
    order = np.argsort(groups, kind="stable")
    starts = np.flatnonzero(np.diff(groups[order], prepend=groups.min() - 1))
    if 2 * len(starts) > len(groups):
        return np.zeros(features.shape[1], np.bool_)
    low, high = (bound.reduceat(features[order], starts) for bound in (np.minimum, np.maximum))
    return np.asarray((low == high).all(axis=0) & (np.ptp(low, axis=0) > 0.0))
