"""How many mesh files of a folder are read, what is said about them, and why others are refused.

    python benchmarks/mesh_files.py build/pybullet_data

Each file is read as it is and, if its size is impossible, again with a radius of 24 mm. `pip download pybullet==3.2.7
--no-deps`, unpacked with `python -m zipfile -e`, has 1 203 files of this kind.
"""

from __future__ import annotations

import argparse
import re
import time
import warnings
from collections import Counter
from pathlib import Path

import numpy as np

from activetouch.errors import BadMesh
from activetouch.shapes import Mesh
from activetouch.solids.mesh_file import ENDINGS

RADIUS = 0.024  # m
KINDS = {
    "several surfaces": r"separate surfaces",
    "edges of more than two triangles": r"edges of more than two",
    "holes": r"open edges",
    "a unit that was guessed": r"read in millimetres",
    "many triangles": r"touches slow",
}


def read(path: Path) -> tuple[Mesh, list[str]]:
    """The mesh in a file, and what was said about it."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            mesh = Mesh.from_file(path)
        except BadMesh as error:
            radius = re.search(r"farthest point is ([\d.e+-]+) m", str(error))
            if radius is None:
                raise
            caught.clear()
            mesh = Mesh.from_file(path, scale=RADIUS / float(radius[1]))
    return mesh, [str(one.message) for one in caught]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder
    files = sorted(path for path in folder.rglob("*") if path.suffix.lower() in ENDINGS)
    said, refused, seconds, triangles = Counter[str](), [], [], []
    for path in files:
        started = time.process_time()
        try:
            mesh, remarks = read(path)
        except BadMesh as error:
            refused.append(f"{path.relative_to(folder)}: {str(error).partition(': ')[2]}")
            continue
        seconds.append(time.process_time() - started)
        triangles.append(len(mesh.faces))
        text = "; ".join(remarks)
        said.update([kind for kind, pattern in KINDS.items() if re.search(pattern, text)] or ["nothing"])
    formats = Counter(path.suffix.lower() for path in files)
    print(f"{len(files)} files: " + ", ".join(f"{number} {kind}" for kind, number in formats.most_common()))
    print(f"{len(seconds)} read, {len(refused)} refused")
    print("said: " + ", ".join(f"{kind} {number}" for kind, number in said.most_common()))
    if seconds:
        middle, most = np.median(seconds), max(seconds)
        print(f"{np.median(triangles):.0f} triangles in the median, {max(triangles)} at most")
        print(f"{1e3 * middle:.0f} ms of processor time in the median, {most:.1f} s at most")
    for line in refused:
        print(f"refused: {line[:200]}")


if __name__ == "__main__":
    main()
