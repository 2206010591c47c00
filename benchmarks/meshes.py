"""Height maps of meshes: maps a second and agreement with exact rays, beside Embree and MuJoCo; presses, beside a cube.

Run: pip install --target build/peers --no-deps embreex         (otherwise Embree is left out)
     OMP_NUM_THREADS=1 python benchmarks/meshes.py --peers build/peers                 (a minute)

Times are of the processor, medians of interleaved rounds; ratios are taken within a round. A difference is the largest
one to `first_entry` where the surface does not fall by more than three pixels next to a pixel. MuJoCo's `mj_multiRay`
starts all rays at one point, so its time is that of rays from a point 1 m away, its difference that of `mj_ray`.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import mujoco
import numpy as np
import trimesh
from rounds import time_in_rounds
from scipy.ndimage import maximum_filter, minimum_filter

from activetouch import SCENES, Quasistatic, TactileSensor, Window, predicted_contacts
from activetouch.placement import Placement
from activetouch.poses import random_orientation, to_matrices
from activetouch.shapes import EXTENDED_SHAPES, KEYED_SHAPES, Mesh, Shape
from activetouch.solids.mesh import first_entry

Floats = np.ndarray
OURS = "predicted_contacts"
WINDOW, MAPS = Window(0.03, 32), 32
FAR = 1.0  # start of rays before the body's centre [m]


def bumpy(columns: int, rows: int, seed: int) -> Mesh:
    """A star-shaped body of ``4 columns (rows - 1)`` triangles about 16 mm from its centre, hollow in places."""
    rng = np.random.default_rng(seed)
    ball = trimesh.creation.uv_sphere(count=(rows, columns))
    waves = np.sin(ball.vertices @ rng.normal(size=(3, 6)) * 2.0 + rng.uniform(0.0, 6.0, 6)).mean(axis=1)
    return Mesh(f"bumpy {seed}", ball.vertices * (0.016 * (1.0 + 0.3 * waves))[:, None], ball.faces)


class Rays:
    """Rays of the maps of a mesh, in its own frame."""

    def __init__(self, mesh: Shape, rotations: Floats, offsets: Floats) -> None:
        z, y = (axis.ravel() for axis in np.meshgrid(WINDOW.centres, WINDOW.centres, indexing="ij"))
        self.turns = to_matrices(rotations)
        places = np.stack([np.full_like(y, -FAR), y, z]) - np.pad(offsets, ((0, 0), (1, 0)))[:, :, None]
        self.origins = self.turns.transpose(0, 2, 1) @ places  # (n, 3, m)
        self.directions = self.turns[:, 0]
        fan = np.stack([np.full_like(y, FAR), y, z])
        self.fans = np.ascontiguousarray((self.turns.transpose(0, 2, 1) @ fan).transpose(0, 2, 1))
        self.starts = self.turns.transpose(0, 2, 1) @ np.array([-FAR, 0.0, 0.0])


def of_embree(mesh: Mesh) -> Callable[[Rays, int], Floats]:
    """One map by Embree."""
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene

    scene = EmbreeScene()
    TriangleMesh(scene, mesh.vertices[mesh.faces].astype(np.float32))

    def one(rays: Rays, i: int) -> Floats:
        origins = np.ascontiguousarray(rays.origins[i].T, np.float32)
        directions = np.broadcast_to(rays.directions[i], origins.shape).astype(np.float32)
        found = scene.run(origins, directions, query="DISTANCE")
        return np.where(found < 1e30, FAR - found, -np.inf)

    return one


def of_mujoco(mesh: Mesh) -> tuple[Callable[[Rays, int], Floats], Callable[[Rays, int], Floats]]:
    """One map by `mj_multiRay` from one point, and by `mj_ray`."""
    spec = mujoco.MjSpec()
    spec.add_mesh(name="mesh", uservert=mesh.vertices.ravel(), userface=mesh.faces.ravel())
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="mesh")
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    number = WINDOW.num_pixels**2
    geoms, distances = np.zeros(number, np.int32), np.zeros(number)

    def many(rays: Rays, i: int) -> Floats:
        mujoco.mj_multiRay(
            model, data, rays.starts[i], rays.fans[i].ravel(), None, 1, -1, geoms, distances, None, number, 1e3
        )
        return distances

    def single(rays: Rays, i: int) -> Floats:
        geom = np.zeros(1, np.int32)
        found = [mujoco.mj_ray(model, data, at, rays.directions[i], None, 1, -1, geom) for at in rays.origins[i].T]
        return np.where(np.array(found) >= 0.0, FAR - np.array(found), -np.inf)

    return many, single


def difference(found: Floats, exact: Floats) -> float:
    """Largest difference of maps away from silhouettes [m]."""
    found, exact = (maps.reshape(-1, WINDOW.num_pixels, WINDOW.num_pixels) for maps in (found, exact))
    with np.errstate(invalid="ignore"):
        fall = maximum_filter(exact, (1, 3, 3)) - minimum_filter(exact, (1, 3, 3))
        smooth = fall < 3 * WINDOW.edge / WINDOW.num_pixels
    return float(np.abs(found[smooth] - exact[smooth]).max())


def exact_maps(mesh: Mesh, rays: Rays, num: int) -> Floats:
    """Maps by the slow and exact rays."""
    found = [first_entry(mesh.vertices, mesh.faces, rays.origins[i], rays.directions[i]) for i in range(num)]
    return FAR - np.array(found)


def placed(num: int, seed: int = 0) -> tuple[Floats, Floats]:
    """Rotations and offsets."""
    rng = np.random.default_rng(seed)
    return np.array([random_orientation(rng) for _ in range(num)]), rng.uniform(-0.002, 0.002, (num, 2))


def measure_maps(mesh: Mesh) -> None:
    """Maps a second, and the largest difference, of all that is installed."""
    rotations, offsets = placed(MAPS)
    rays, few = Rays(mesh, rotations, offsets), 4
    many, single = of_mujoco(mesh)
    ours = predicted_contacts(mesh, rotations, offsets, WINDOW)
    exact = exact_maps(mesh, rays, few)
    one_map: dict[str, Callable[[Rays, int], Floats]] = {"mj_multiRay": many}
    agreement = {OURS: difference(ours[:few], exact), "mj_multiRay": difference(maps_of(single, rays, few), exact)}
    if embree := installed("embreex"):
        one_map[f"Embree (embreex {embree})"] = of_embree(mesh)
        agreement[f"Embree (embreex {embree})"] = difference(maps_of(of_embree(mesh), rays, few), exact)
    calls: dict[str, Callable[[int], object]] = {OURS: lambda _: predicted_contacts(mesh, rotations, offsets, WINDOW)}
    for name, one in one_map.items():
        calls[name] = lambda _, one=one: [one(rays, i) for i in range(MAPS)]
    times = time_in_rounds(calls, 9, 1)
    print(f"\n{len(mesh.faces)} triangles, maps of {WINDOW.num_pixels} × {WINDOW.num_pixels}")
    for name, taken in times.items():
        ratio = float(np.median(taken / times[OURS]))
        speed = f"{1e3 * MAPS / np.median(taken):8.0f} maps/s {ratio:8.3g} times the time of ours"
        print(f"{name:<32}{speed}, largest difference {agreement[name]:.1e} m", flush=True)


def maps_of(one: Callable[[Rays, int], Floats], rays: Rays, num: int) -> Floats:
    """The first maps."""
    return np.array([one(rays, i) for i in range(num)])


def measure_agreement() -> None:
    """The largest difference to rays one by one, over all solids and ten meshes."""
    rotations, offsets = placed(20, seed=1)
    solids = {**EXTENDED_SHAPES, **KEYED_SHAPES}
    worst = 0.0
    for solid in solids.values():
        rays = Rays(solid, rotations, offsets)
        exact = FAR - np.array([solid.entry_distance(*ray) for ray in zip(rays.origins, rays.directions, strict=True)])
        worst = max(worst, difference(predicted_contacts(solid, rotations, offsets, WINDOW), exact))
    print(f"\nlargest difference to rays that start {FAR:g} m away, {len(solids)} solids: {worst:.1e} m")
    meshes = [bumpy(10 + 3 * i, 11 + 2 * i, seed=i) for i in range(9)]
    ring = trimesh.creation.torus(0.014, 0.005)
    worst = 0.0
    for mesh in (*meshes, Mesh("ring", ring.vertices, ring.faces)):
        exact = exact_maps(mesh, Rays(mesh, rotations, offsets), len(rotations))
        worst = max(worst, difference(predicted_contacts(mesh, rotations, offsets, WINDOW), exact))
    print(f"the same, {len(meshes) + 1} meshes: {worst:.1e} m")


def measure_presses(mesh: Mesh) -> None:
    """A quasistatic press of a mesh beside that of the cube: the press, with image and faults, with the network."""
    print(f"\nquasistatic press of {len(mesh.faces)} triangles, times that of the cube")
    for name in ("gel", "coarse"):
        for part, calls in presses(name, mesh).items():
            times = time_in_rounds(calls, 60, 5)
            cube, ours = (float(np.median(times[body])) for body in ("cube", "mesh"))
            ratio = float(np.median(times["mesh"] / times["cube"]))
            print(f"{name:<8}{part:<24}{cube:7.3f} ms {ours:7.3f} ms {ratio:6.2f}", flush=True)


def presses(name: str, mesh: Mesh) -> dict[str, dict[str, Callable[[int], object]]]:
    """A press of the cube and of a mesh in a scene; with the image and its faults; and with the network's reading."""
    scene = replace(SCENES[name].scene, shapes=SCENES[name].scene.shapes | {"mesh": mesh}, press_model=Quasistatic())
    sensor, rng = TactileSensor.shipped(name), np.random.default_rng(0)
    rotations, offsets = placed(5, seed=2)

    def press(body: str, i: int) -> object:
        placement = Placement(scene.solids[body], 1.0, rotations[i], offsets[i])
        return Quasistatic().press(scene.pad, placement, 2.0)

    def image(body: str, i: int) -> np.ndarray:
        return scene.press(scene.sample_object(body, rng), i, rng).image

    def touch(body: str, i: int) -> object:
        return sensor.read(image(body, i)[None], [i])

    parts = {"press": press, "press, image and faults": image, "touch": touch}
    return {part: {body: partial(call, body) for body in ("cube", "mesh")} for part, call in parts.items()}


def installed(package: str) -> str:
    """Its version, or nothing."""
    try:
        return version(package)
    except PackageNotFoundError:
        return ""


def main() -> None:
    """Print all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--peers", type=Path, default=Path("build/peers"), help="folder of packages to compare with")
    sys.path.append(str(parser.parse_args().peers))
    embree = installed("embreex") or "not installed"
    print(f"Python {sys.version.split()[0]}, numpy {np.__version__}, MuJoCo {mujoco.__version__}, embreex {embree}")
    small, large = bumpy(10, 11, seed=0), bumpy(100, 51, seed=0)
    measure_maps(small)
    measure_maps(large)
    measure_agreement()
    measure_presses(small)


if __name__ == "__main__":
    main()
