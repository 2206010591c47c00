"""A reader of the sensor beside the shipped sensor of a scene, on the same touches of the same objects.

    python -m benchmarks.sensor_reader.evaluate gel benchmarks/sensor_reader/gel.safetensors

None of the shapes was trained on. Prints, after 1, 2, 3, 4 and 6 touches in random poses: accuracy, stated probability
and negative log-likelihood [nats].
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.special import logsumexp

from activetouch import SCENES, Scene, TactileSensor, predicted_contacts
from activetouch.hypotheses import sizes
from activetouch.perception.reader import resized
from activetouch.perception.sealed_tensors import read_tensors
from activetouch.poses import turned
from benchmarks.sensor_reader.network import ContactReader
from benchmarks.sensor_reader.touches import Imaging, World, encoded
from benchmarks.sensor_reader.train import SENSORS

TOUCHES = (1, 2, 3, 4, 6)
AT_ONCE = 512
Floats = NDArray[np.floating]


def load(path: Path) -> ContactReader:
    """The networks in the state of a training."""
    arrays, fields = read_tensors(path)
    recipe = fields["recipe"]
    network = ContactReader(tuple(recipe["widths"]), recipe["dense"], recipe["embedding"])
    parts = {name: torch.from_numpy(array.astype(np.float32)) for name, array in arrays.items()}
    network.load_state_dict({name.removeprefix("model."): part for name, part in parts.items() if name[:6] == "model."})
    print(f"{fields['step']} steps, {sum(part.numel() for part in network.parameters())} parameters")
    return network.eval()


def cell_of(num_hypotheses: int) -> float:
    """Standard deviation of an orientation about each axis in the cell of one of so many hypotheses [rad]."""
    return (8 * math.pi**2 / num_hypotheses) ** (1 / 3) / math.sqrt(12)


@torch.inference_mode()
def table(network: ContactReader, scene: Scene, imaging: Imaging, num_hypotheses: int) -> Floats:
    """Embedded hypotheses of the shapes of a scene in the nominal world, ``(P, K, N, D)``."""
    rests, factors = scene.presentation.rests(num_hypotheses), sizes(scene.variation.size, num_hypotheses)
    cells = torch.full((num_hypotheses,), cell_of(num_hypotheses))
    code = torch.from_numpy(World.nominal(1).code())
    found = []
    for rotation, aim in zip(scene.rotations.values(), scene.aim_offsets, strict=True):
        for shape in scene.solids.values():
            window, turns = imaging.wide_window, turned(rotation, rests)
            maps = predicted_contacts(shape, turns, aim, window, factors, np.float32)
            contacts = torch.from_numpy(encoded(maps, imaging.contact_pixels))
            with torch.autocast("cpu", torch.bfloat16):
                parts = [
                    network.h(some, width, code)[0]
                    for some, width in zip(contacts.split(AT_ONCE), cells.split(AT_ONCE), strict=True)
                ]
            found.append(torch.cat(parts).numpy())
    return np.stack(found).reshape(len(scene.poses), len(scene.shapes), num_hypotheses, -1)


def report(name: str, logits: dict[int, Floats], truth: NDArray[np.intp]) -> None:
    """Print one line for one sensor."""
    parts = []
    for num, some in logits.items():
        logs = some - logsumexp(some, axis=1, keepdims=True)
        right, stated = (logs.argmax(axis=1) == truth).mean(), np.exp(logs.max(axis=1)).mean()
        parts.append(f"{num}: {right:.3f} stated {stated:.3f} NLL {-logs[np.arange(len(truth)), truth].mean():.3f}")
    print(f"{name:9} " + " | ".join(parts))


def main() -> None:
    """Press the objects once, and read them with both."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene")
    parser.add_argument("state", type=Path)
    parser.add_argument("--pad", choices=list(SENSORS), help="whose reader it is; that of the scene by default")
    parser.add_argument("--objects", type=int, default=240)
    parser.add_argument("--hypotheses", type=int, default=1024)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    scene, imaging = SCENES[given.scene].scene, SENSORS[given.pad or given.scene]()
    network, shipped = load(given.state), TactileSensor.shipped(given.scene)
    rng, num_poses = np.random.default_rng([given.seed, 0x70AD]), len(scene.poses)
    truth = np.arange(given.objects) % len(scene.shapes)
    order = np.array([rng.permutation(num_poses)[: max(TOUCHES)] for _ in truth])
    images = []
    for shape, poses in zip(truth, order, strict=True):
        thing = scene.sample_object(int(shape), rng)
        images.append(np.stack([scene.press(thing, int(pose), rng).image for pose in poses]))
    flat = np.concatenate(images)
    seen = resized(flat, (imaging.pixels, imaging.pixels)).astype(np.float32) / 255
    with torch.inference_mode():
        embedded = network.f(torch.from_numpy(seen)).numpy().reshape(*order.shape, -1)
    hypotheses = table(network, scene, imaging, given.hypotheses)
    ours: dict[int, list[Floats]] = {num: [] for num in TOUCHES}
    theirs: dict[int, list[Floats]] = {num: [] for num in TOUCHES}
    for poses, some, row in zip(order, images, embedded, strict=True):
        scores = np.cumsum([hypotheses[pose] @ one for pose, one in zip(poses, row, strict=True)], axis=0)
        evidence = shipped.model.start()
        for num, touch in enumerate(shipped.read(some, poses.tolist()), 1):
            evidence = evidence.update(touch)
            if num in TOUCHES:
                ours[num].append(logsumexp(scores[num - 1], axis=1))
                theirs[num].append(evidence.log_likelihood)
    print(f"scene {given.scene}, {given.objects} objects, {given.hypotheses} hypotheses of each shape")
    report("reader", {num: np.array(logs) for num, logs in ours.items()}, truth)
    report("shipped", {num: np.array(logs) for num, logs in theirs.items()}, truth)


if __name__ == "__main__":
    main()
