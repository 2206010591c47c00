"""The format ``bts3``: grasps of objects in three hand poses with three BioTac SP fingers of 24 electrodes.

From the BioTac SP Stability Set v2 (MIT). Files ``bts3v2_palm_POSE.csv``, also compressed as ``.csv.gz``, have the
columns ``object,slipped,ff_biotac_1,…``. Whether the object slipped is known only after the touch, and is no feature.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from activetouch.errors import BadRecording
from activetouch.recorded.bounded import Numbers, lines_of, require_folder
from activetouch.recorded.named_columns import touches_of_columns
from activetouch.recorded.touches import RecordedTouches
from belief.files import plain_number

POSES = ("down", "45", "side")
_ELECTRODES = 72


def read_bts3(folder: Path) -> tuple[RecordedTouches, tuple[str, ...]]:
    """The grasps of the 41 objects of the training files, and what was left out.

    Raises:
        BadRecording: a file is missing or cannot be read; the message names the line.
    """
    require_folder(folder, "bts3v2_palm_down.csv, bts3v2_palm_45.csv and bts3v2_palm_side.csv (or .csv.gz)")
    numbers = Numbers()
    electrodes: tuple[str, ...] = ()
    names: list[str] = []
    actions: list[str] = []
    for pose in POSES:
        found = [path for end in ("csv", "csv.gz") if (path := folder / f"bts3v2_palm_{pose}.{end}").exists()]
        if not found:
            raise BadRecording(f"there is no file bts3v2_palm_{pose}.csv or .csv.gz in {folder}")
        for number, line in lines_of(found[0]):
            cells = line.split(",")
            if len(cells) != _ELECTRODES + 2:
                raise BadRecording(
                    f"line {number} of {found[0]} has {len(cells)} cells instead of {_ELECTRODES + 2}: object, "
                    f"slipped, {_ELECTRODES} electrodes"
                )
            if number == 1:
                electrodes = tuple(name.strip() for name in cells[2:])
                continue
            try:
                row = [plain_number(cell) for cell in cells[2:]]
            except ValueError as error:
                raise BadRecording(
                    f"line {number} of {found[0]} holds something that is not a number: {error}"
                ) from error
            numbers.add(row)
            names.append(cells[0])
            actions.append(f"palm {pose}")
    if not names:
        raise BadRecording(f"the files in {folder} have no rows below their headers")
    touches = touches_of_columns(
        numbers.table(),
        {"object": np.array(names), "action": np.array(actions)},
        str(folder),
        action_names=[f"palm {pose}" for pose in POSES],
        feature_names=electrodes,
        provenance="BioTac SP Stability Set v2 (3dperceptionlab/biotacsp-stability-set-v2), 41 training objects",
        licence="MIT",
    )
    return touches, ("the column 'slipped' is left out: it is known only after the touch",)
