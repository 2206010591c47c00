"""The format ``cy101``: features of joint torques and of vibration of an arm that performs nine behaviours.

Each file ``BEHAVIOUR_MODALITY.txt`` has a line ``OBJECT_tN,v1,v2,…`` for each trial N of an object. The set states no
licence: it is read from a user's folder and never comes with this package.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from activetouch.errors import BadRecording
from activetouch.recorded.formats import require_folder, touches_of_columns
from activetouch.recorded.touches import RecordedTouches
from belief.columns import lines_of, require_bounded
from belief.files import plain_number
from belief.validation import Floats

BEHAVIOURS = ("crush", "grasp", "hold", "lift_slow", "low_drop", "poke", "push", "shake", "tap")
_WIDTHS = {"haptics": 70, "vibro": 100}
_NOTHING = "no_object"
_NAME = re.compile(r"([A-Za-z0-9_-]{1,80})_t([0-9]{1,4})")


def read_cy101(folder: Path) -> tuple[RecordedTouches, tuple[str, ...]]:
    """The touches of all objects that are complete, and what was left out; raises BadRecording."""
    require_folder(folder, "the text files of cy101, such as crush_haptics.txt")
    rows: dict[tuple[str, int, int, str], Floats] = {}
    notes: list[str] = []
    for action, behaviour in enumerate(BEHAVIOURS):
        for modality, width in _WIDTHS.items():
            path = folder / f"{behaviour}_{modality}.txt"
            for name, session, values, problem in _lines(path, width):
                if problem:
                    notes.append(problem)
                elif (key := (name, session, action, modality)) in rows:
                    raise BadRecording(f"{path} has two lines for {name}_t{session}")
                else:
                    rows[key] = values
                    require_bounded(
                        (len(rows) + 1) // 2, sum(_WIDTHS.values()) * len(rows) // 2, str(folder), BadRecording
                    )
    sessions = sorted({key[1] for key in rows})
    wanted = [(session, action) for session in sessions for action in range(len(BEHAVIOURS))]
    names, incomplete = [], []
    for name in sorted({key[0] for key in rows} - {_NOTHING}):
        missing = [(s, a) for s, a in wanted if any((name, s, a, m) not in rows for m in _WIDTHS)]
        if missing:
            incomplete.append(name)
        else:
            names.append(name)
    if incomplete:
        notes.append(
            f"{len(incomplete)} objects are left out as recordings of them are missing: {', '.join(incomplete)}"
        )
    if any(key[0] == _NOTHING for key in rows):
        notes.append(f"{_NOTHING}, behaviours in the air, is no object and is left out")
    if not names:
        raise BadRecording(f"no object in {folder} has all behaviours in all trials {sessions}")
    order = [(name, session, action) for name in names for session, action in wanted]
    parts = {m: np.array([rows[(*key, m)] for key in order]) for m in _WIDTHS}
    objects, trials, actions = (np.array(column) for column in zip(*order, strict=True))
    touches = touches_of_columns(
        np.concatenate(list(parts.values()), axis=1),
        {
            "object": objects,
            "action": np.array(BEHAVIOURS)[actions],
            "session": trials,
            "category": np.array([name.split("_")[0] for name in objects.tolist()]),
        },
        str(folder),
        action_names=BEHAVIOURS,
        feature_names=[f"{m} {number}" for m, width in _WIDTHS.items() for number in range(1, width + 1)],
        provenance="CY101 features in keke-220/predicate-learning, data/cy101/sensorimotor_features",
        licence="none stated: not redistributed",
    )
    return touches, tuple(notes)


def _lines(path: Path, width: int) -> Iterator[tuple[str, int, Floats, str]]:
    """Object, trial and values of each line, or what is wrong with the line."""
    if not path.exists():
        raise BadRecording(f"there is no file {path}; cy101 has one for each behaviour and modality")
    for number, line in enumerate(lines_of(path, BadRecording), 1):
        if not line.strip():
            continue
        name, *values = line.strip().split(",")
        found = _NAME.fullmatch(name)
        if found is None:
            raise BadRecording(f"line {number} of {path} must begin with OBJECT_tN, got {name[:80]!r}")
        where = f"line {number} of {path.name} ({name})"
        if len(values) != width:
            yield found[1], int(found[2]), np.empty(0), f"{where} is cut short: {len(values)} values instead of {width}"
            continue
        try:
            row = np.array([plain_number(value) for value in values])
        except ValueError as error:
            raise BadRecording(f"{where} holds something that is not a number: {error}") from error
        if not np.isfinite(row).all():
            yield found[1], int(found[2]), np.empty(0), f"{where} holds a value that is not finite"
            continue
        yield found[1], int(found[2]), row, ""
