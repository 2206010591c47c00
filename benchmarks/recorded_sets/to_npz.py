"""Public sets of recorded touches as ``.npz`` files, which ``activetouch recorded --format npz`` reads.

    python -m benchmarks.recorded_sets.to_npz cy101 cy101 cy101.npz
    python -m benchmarks.recorded_sets.to_npz sdh2 sdh2 sdh2.npz

Arguments are the set, the folder of its recordings, and the file to write.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from activetouch.recorded import RecordedTouches
from activetouch.recorded.formats import KINDS_OF
from benchmarks.recorded_sets.cy101 import read_cy101
from benchmarks.recorded_sets.sdh2 import read_sdh2

SETS: Mapping[str, Callable[[Path], tuple[RecordedTouches, tuple[str, ...]]]] = {
    "cy101": read_cy101,
    "sdh2": read_sdh2,
}
"""Functions that read a folder: they return the touches, and sentences about what was left out."""


def write_npz(touches: RecordedTouches, path: Path) -> None:
    """Write touches that ``read_recorded(path, "npz")`` reads; their actions must be in alphabetical order."""
    assert list(touches.action_names) == sorted(touches.action_names)
    arrays: dict[str, Any] = {
        "features": touches.features,
        "object": np.array(touches.object_names)[touches.objects],
        "action": np.array(touches.action_names)[touches.actions],
        "session": touches.sessions,
        "provenance": np.array(touches.provenance),
        "licence": np.array(touches.licence),
        **{KINDS_OF[task]: np.array(kinds)[touches.objects] for task, kinds in touches.kinds.items()},
    }
    if touches.feature_names:
        arrays["feature_names"] = np.array(touches.feature_names)
    np.savez_compressed(path, **arrays)


def main(name: str, folder: str, path: str) -> None:
    touches, notes = SETS[name](Path(folder))
    for note in notes:
        print(f"- {note}")
    write_npz(touches, Path(path))
    print(f"wrote {touches.num_touches} touches to {path}")


if __name__ == "__main__":
    main(*sys.argv[1:])
