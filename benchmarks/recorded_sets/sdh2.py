"""The format ``sdh2``: grasps of a three-finger hand with six pressure pads, one ``.dsa`` file each in OBJECT folders.

The recordings are under GPL-3.0: they are read from a user's folder and never come with this package.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from activetouch.errors import BadRecording
from activetouch.recorded.formats import require_folder, touches_of_columns
from activetouch.recorded.touches import RecordedTouches
from belief.columns import require_bounded
from benchmarks.recorded_sets.dsa import read_dsa
from benchmarks.recorded_sets.pressure_features import grasp_features

_MOST_FILES = 100_000
_FIRST_FRAME = re.compile(r"_([0-9]+)-[0-9]+\.dsa$")
SHAPES: Mapping[str, tuple[str, ...]] = {
    "sphere": (
        "christmas_ball",
        "foam_ball",
        "golf_ball",
        "green_plastic_ball_large",
        "green_plastic_ball_small",
        "hockey_ball",
        "ping-pong_ball",
        "tennis_ball",
    ),
    "box": ("dice_large", "dice_small", "wooden_block_flat", "wooden_block_small"),
    "cylinder": (
        "aerosol_can",
        "bottle_glass",
        "bottle_plastic_vinegar",
        "pen_medium",
        "pen_thick",
        "pen_thin",
        "wooden_cylinder",
    ),
}
"""Objects whose shape is one of ours."""


def read_sdh2(folder: Path) -> tuple[RecordedTouches, tuple[str, ...]]:
    """The grasps in all object folders, also of a subfolder ``grasps``, in recording order; raises BadRecording."""
    require_folder(folder, "a folder for each object with its .dsa files")
    top = folder / "grasps" if (folder / "grasps").is_dir() else folder
    paths = sorted(top.glob("*/*.dsa"), key=_place)
    if not 0 < len(paths) <= _MOST_FILES:
        raise BadRecording(f"{top} must hold folders with 1 to {_MOST_FILES} .dsa files, found {len(paths)}")
    features = []
    shapes = read_dsa(paths[0]).shapes
    for path in paths:
        film = read_dsa(path)
        if film.shapes != shapes:
            raise BadRecording(f"{path} has pads {film.shapes}, {paths[0]} has {shapes}")
        features.append(grasp_features(film))
        require_bounded(len(paths), len(paths) * len(features[0]), str(top), BadRecording)
    names = [path.parent.name for path in paths]
    shape_of = {name: shape for shape, members in SHAPES.items() for name in members}
    touches = touches_of_columns(
        np.array(features),
        {
            "object": np.array(names),
            "action": np.full(len(names), "grasp"),
            "shape": np.array([shape_of.get(name, "") for name in names]),
        },
        str(top),
        provenance="peter-kiechle/tactile-sensors, training_grasp_profiles_thesis; joint angles left out",
        licence="GPL-3.0: not redistributed",
    )
    return touches, ()


def _place(path: Path) -> tuple[str, int, str]:
    """Key of the order of recording: the object, and the first frame in the session, which the file name gives."""
    found = _FIRST_FRAME.search(path.name)
    return path.parent.name, int(found[1]) if found else 0, path.name
