"""Search for an object from a mesh file, a cup, among the four built-in shapes. Nothing is trained.

Run: python examples/04_a_mesh_of_your_own.py [options of compare]   (42 s of processor time; writes to runs/cup)

The sensor of the scene gel has a reader of any object: it predicts from the mesh what touches of the cup look like.
"""

import shlex
import sys
from pathlib import Path

import numpy as np

from experiments.cli import main

FOLDER = Path("runs/cup")
# A cup, turned about z: its outer wall, its rim, its inner wall and its bottom, as radius and height [m].
PROFILE = np.array([[0.0, -0.020], [0.014, -0.020], [0.019, 0.020], [0.016, 0.020], [0.012, -0.016], [0.0, -0.016]])
NUM_SIDES = 24


def write_cup(path: Path) -> None:
    """Turn the profile about the z axis and write the solid as an OBJ file, corners counter-clockwise from outside."""
    angles = np.linspace(0.0, 2 * np.pi, NUM_SIDES, endpoint=False)
    rings = [[(r * np.cos(a), r * np.sin(a), z) for a in angles] for r, z in PROFILE[1:-1]]
    vertices = [(0.0, 0.0, PROFILE[0, 1]), *np.concatenate(rings), (0.0, 0.0, PROFILE[-1, 1])]
    faces, last = [], len(vertices) - 1
    for side in range(NUM_SIDES):
        following = (side + 1) % NUM_SIDES
        faces += [(0, 1 + following, 1 + side)]
        for ring in range(len(rings) - 1):
            a, b = 1 + ring * NUM_SIDES + side, 1 + ring * NUM_SIDES + following
            faces += [(a, b, b + NUM_SIDES), (a, b + NUM_SIDES, a + NUM_SIDES)]
        inner = 1 + (len(rings) - 1) * NUM_SIDES
        faces += [(last, inner + side, inner + following)]
    lines = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in vertices]
    lines += ["f " + " ".join(str(corner + 1) for corner in face) for face in faces]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")


if __name__ == "__main__":
    cup = FOLDER / "cup.obj"
    write_cup(cup)
    command = (
        f"compare --meshes {cup} --num-objects 5 --targets cup --episodes 10 "
        f"--deciders information_gain random_confirm --out {FOLDER}/compare"
    )
    sys.argv[:1] = ["activetouch", *shlex.split(command)]
    print("$", shlex.join(sys.argv), flush=True)
    main()
