"""Fingers that close in MuJoCo beside quasistatic grasps of the same bodies, and grasps of the Allegro hand.

    python -m benchmarks.closing --meshes build/pybullet_data/random_urdfs
    python -m benchmarks.closing --grasps 300 --menagerie mujoco_menagerie

Twelve shapes and the first meshes of a folder, scaled to the size of the shapes, take turns. The body can turn, or
the palm holds its orientation, as in a quasistatic grasp. Images are compared before the faults of the sensor.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from activetouch import SCENES, Scene
from activetouch.errors import UnstablePress
from activetouch.pressing.allegro import ALLEGRO_LAW, ALLEGRO_PAD, AllegroFingers
from activetouch.pressing.closing import Closing
from activetouch.pressing.press import Grasp, Quasistatic
from activetouch.shapes import EXTENDED_SHAPES, Mesh
from activetouch.solids.solid import Shape
from belief.statistics import wilson_interval

MESH_RADIUS = 0.025  # of the bounding ball of a mesh [m]


def bodies(folder: Path | None, meshes: int) -> dict[str, Shape]:
    """Twelve shapes and some meshes of a folder, all about as large as a hand can hold."""
    found: dict[str, Shape] = dict(EXTENDED_SHAPES)
    for path in sorted(folder.rglob("*.obj"))[:meshes] if folder else []:
        mesh = Mesh.from_file(path, scale=0.01)
        found[f"mesh {path.stem}"] = Mesh(path.stem, mesh.vertices * (MESH_RADIUS / mesh.bounding_radius), mesh.faces)
    return found


def image(scene: Scene, grasp: Grasp) -> NDArray[np.floating]:
    """The ideal images of all fingers, one after another."""
    return np.concatenate([scene.image(contact).ravel() for contact in grasp.contacts])


def compare(scene: Scene, law: Closing, grasps: int, seed: int) -> str:
    """A row of the table: what grasps that are simulated have in common with quasistatic ones."""
    assert scene.hand is not None
    hand, rotations, quasistatic = scene.hand, scene.hand.rotations, Quasistatic()
    unsettled, seconds = 0, 0.0
    rows = []
    for number in range(grasps):
        rng = np.random.default_rng([seed, number])
        obj = scene.sample_object(number % len(scene.shapes), rng)
        placement, depth = scene.place_in_palm(obj, number % len(scene.poses), rng)
        met, centre = hand.placements(placement, depth), np.array([depth, *placement.offset])
        forces = (hand.forces * scene.variation.force.sample(rng)).tolist()
        still = quasistatic.close(scene.pad, met, rotations, centre, forces)
        started = time.process_time()
        try:
            moved = law.close(scene.pad, met, rotations, centre, forces)
        except UnstablePress:
            unsettled += 1
            continue
        finally:
            seconds += time.process_time() - started
        there = quasistatic.close(scene.pad, moved.met, rotations, centre, forces)  # where the body came to rest
        images = [image(scene, grasp) for grasp in (moved, still, there)]
        normals = [contact.force for contact in moved.contacts]
        turned = abs(float(still.met[0].orientation @ moved.met[0].orientation))
        rows.append(
            (
                [force > 0.0 for force in normals] == [contact.force > 0.0 for contact in still.contacts],
                float(np.linalg.norm(moved.net_force)) / max(sum(normals), 1e-9),
                np.corrcoef(images[0], images[1])[0, 1],
                np.abs(images[0] - images[2]).mean(),
                np.rad2deg(2 * np.arccos(min(turned, 1.0))),
            )
        )
    same, net, alike, there_off, turns = (np.array(column, float) for column in zip(*rows, strict=True))
    low, high = wilson_interval(int(same.sum()), grasps)
    return (
        f"{unsettled} | {same.sum() / grasps:.3f} [{low:.3f}, {high:.3f}] | {net.max():.2%} | "
        f"{np.median(turns):.1f}° ({np.quantile(turns, 0.95):.1f}°) | "
        f"{np.nanmedian(alike):.3f} ({np.nanquantile(alike, 0.05):.3f}) | {there_off.max():.4f} | "
        f"{1e3 * seconds / grasps:.0f} ms"
    )


def allegro(scene: Scene, folder: Path, grasps: int, seed: int) -> str:
    """What grasps of the Allegro hand have in common: a sentence."""
    unsettled, seconds, all_touch = 0, 0.0, 0
    net = []
    for number in range(grasps):
        rng = np.random.default_rng([seed, number])
        obj = scene.sample_object(number % len(scene.shapes), rng)
        placement, depth = scene.place_in_palm(obj, number % len(scene.poses), rng)
        force = scene.variation.force.sample(rng)
        started = time.process_time()
        try:
            fingers = AllegroFingers(ALLEGRO_LAW, folder, ALLEGRO_PAD, placement, depth)
            grasp = ALLEGRO_LAW.settle(fingers, placement, np.full(len(fingers), force))
        except UnstablePress:
            unsettled += 1
            continue
        finally:
            seconds += time.process_time() - started
        normals = [contact.force for contact in grasp.contacts]
        all_touch += min(normals) > 0.0
        net.append(float(np.linalg.norm(grasp.net_force)) / max(sum(normals), 1e-9))
    low, high = wilson_interval(unsettled, grasps)
    return (
        f"{grasps} grasps of the Allegro hand: {unsettled} unsettled ({unsettled / grasps:.3f} [{low:.3f}, "
        f"{high:.3f}]), all four pads touch in {all_touch}, net force at most {max(net):.2%}, "
        f"{grasps / seconds:.1f} grasps a second of processor time"
    )


def main() -> None:
    """Print a table of hands, and a sentence about the Allegro hand."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hands", nargs="+", default=["parallel", "three_finger"])
    parser.add_argument("--grasps", type=int, default=1000)
    parser.add_argument("--meshes", type=Path, help="folder of OBJ files")
    parser.add_argument("--number", type=int, default=8, help="of meshes")
    parser.add_argument("--menagerie", type=Path, help="a copy of MuJoCo Menagerie: the Allegro hand alone")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    shapes = bodies(arguments.meshes, arguments.number)
    scene = replace(SCENES["coarse"].scene, shapes=shapes, faults=())
    print(f"{arguments.grasps} grasps of {len(shapes)} bodies: {', '.join(shapes)}\n")
    if arguments.menagerie is not None:
        print(allegro(scene.with_hand("allegro"), arguments.menagerie, arguments.grasps, arguments.seed))
        return
    print(
        "| hand | body | unsettled | same pads touch [95 %] | net force, most | turns by, median (95 %) | image "
        "correlation, median (5 %) | image error where it rests, most | processor time |"
    )
    print("|---|---|---:|---|---:|---|---|---:|---:|")
    for name in arguments.hands:
        for turns in (False, True):
            row = compare(scene.with_hand(name), Closing(turns=turns), arguments.grasps, arguments.seed)
            print(f"| {name} | {'turns' if turns else 'held'} | {row} |", flush=True)


if __name__ == "__main__":
    main()
