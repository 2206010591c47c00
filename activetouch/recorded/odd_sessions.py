"""Sessions in which features have another unit or sign than in the others, or each other's place."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from activetouch.recorded.touches import RecordedTouches
from belief.naming import few
from belief.validation import Floats

_FACTOR = 30.0  # between sessions of an object, from which a feature has another unit
_MOST, _FEWEST = 0.75, 3  # share of the touches of a session, and their number, from which it is odd
_APART = 4.0  # median deviations, within which values are alike
_TRIED = 40  # features of a session that may be in each other's place, at most


def odd_sessions(touches: RecordedTouches) -> tuple[str, ...]:
    """Sentences about sessions in which features have another unit or sign than in others, or each other's place.

    Touches are compared with the medians of their object and action, where these have at least three sessions. A
    session is that of all objects, or else that of one object.

    >>> rows = np.tile([[1.0, 5.0], [2.0, 6.0]], (8, 1))
    >>> rows[-4:, 0] *= 1000.0
    >>> mugs = RecordedTouches(rows, [0] * 16, [0, 1] * 8, np.arange(16) // 4, ("press",), ("mug", "cup"))
    >>> odd_sessions(mugs)  # doctest: +ELLIPSIS
    ('feature 0 of session 3: about 1000 times the values of other sessions of the same objects; ...',)
    """
    kept = touches.session_counts()[touches.objects, touches.actions] >= _FEWEST
    if not kept.any():
        return ()
    touches = touches.only(kept)
    rows, sessions = touches.features, touches.sessions
    known = touches.objects * touches.num_actions + touches.actions
    usual, size = _medians(rows, known), _medians(np.abs(rows), known)
    typical = _medians(np.stack([np.abs(rows[sessions == one]).mean(axis=0) for one in np.unique(sessions)]))
    least = np.where(size > 0.0, np.maximum(size, 0.1 * typical), typical)
    apart = _APART * _medians(np.abs(rows - usual))
    names = touches.feature_names or [f"feature {i}" for i in range(rows.shape[1])]
    found, told = dict[str, list[str]](), set[int]()
    of_objects = np.stack([sessions, touches.objects], axis=1)
    for columns in (1, 2):
        each, number, counts = np.unique(of_objects[:, :columns], axis=0, return_inverse=True, return_counts=True)
        for place in np.flatnonzero(counts >= _FEWEST).tolist():
            session, owners = int(each[place, 0]), each[place, 1:].tolist()
            here = number.ravel() == place
            if session in told:
                continue
            odd = _odd(rows[here], usual[here], size[here], least[here], apart[0])
            told |= {session} if odd and not owners else set()
            where = f"session {session}" + "".join(f" of {touches.object_names[owner]}" for owner in owners)
            for what, features in odd:
                listed = few([names[i] for i in features], 12)
                found.setdefault(f"{listed} of {{}}: {what}", []).append(where)
    return tuple(text.format(few(where, 6)) for text, where in found.items())


def _odd(rows: Floats, usual: Floats, size: Floats, least: Floats, apart: Floats) -> list[tuple[str, list[int]]]:
    """What is odd about the touches of a session, and about which features; all are ``(n, F)``, ``apart`` is ``(F,)``.

    Beside the touches are, for their object and action, the medians of values and of their sizes, and the sizes from
    which another unit is counted; within ``apart`` values are alike.
    """
    found = list[tuple[str, list[int]]]()
    sizes = np.abs(rows)
    is_scaled = _are_most((sizes > _FACTOR * least) & (least > 0.0)) | _are_most(
        (sizes * _FACTOR < size) & (sizes > 0.0)
    )
    beside = np.where(size > 0.0, size, least)
    with np.errstate(divide="ignore", invalid="ignore"):  # of features that are zero
        powers = np.round(np.median(np.log10(sizes) - np.log10(beside), axis=0))
    for power in np.unique(powers[is_scaled]).tolist():
        features = np.flatnonzero(is_scaled & (powers == power)).tolist()
        what = f"about {10.0**power:g} times the values of other sessions of the same objects"
        found.append((f"{what}; use one unit, or leave these touches out", features))
    is_known = np.abs(usual) > apart
    flipped = np.flatnonzero(~is_scaled & _are_most(np.abs(rows + usual) <= apart, is_known)).tolist()
    if flipped:
        found.append(("the other sign than in other sessions of the same objects", flipped))
    is_away = np.asarray((np.abs(rows - usual) > apart).sum(axis=0) >= _FEWEST)
    away = np.flatnonzero(is_away & ~is_scaled)[:_TRIED]
    for place, one in enumerate(away.tolist()):
        rest, mine = away[place + 1 :], slice(one, one + 1)
        is_known = np.abs(usual[:, mine] - usual[:, rest]) > apart[one] + apart[rest]
        is_other = np.abs(rows[:, mine] - usual[:, rest]) <= apart[rest]
        is_other &= np.abs(rows[:, rest] - usual[:, mine]) <= apart[one]
        others = rest[_are_most(is_other, is_known)].tolist()
        found += [("they seem to be in each other's place", [one, other]) for other in others]
    return found


def _are_most(which: NDArray[np.bool_], among: NDArray[np.bool_] | bool = True) -> NDArray[np.bool_]:
    """Whether most of the touches are so, and enough of them, ``(F,)``, among those that could show it ``(n, F)``."""
    number = np.broadcast_to(among, which.shape).sum(axis=0)
    return np.asarray((which & among).sum(axis=0) >= np.maximum(_MOST * number, _FEWEST))


def _medians(rows: Floats, groups: NDArray[np.int64] | None = None) -> Floats:
    """Median of the group of each row ``(n, F)``, or of all rows ``(1, F)``."""
    if groups is None:
        return np.median(rows, axis=0, keepdims=True)
    found = np.empty_like(rows)
    for one in np.unique(groups):
        here = groups == one
        found[here] = np.median(rows[here], axis=0)
    return found
