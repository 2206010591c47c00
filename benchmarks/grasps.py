"""What grasps are worth: actions to a stated probability for hands of one, two and more pads, paired by object.

    python -m benchmarks.grasps --objects 400 --searches 400

First, each object is touched in palm poses of random order until a shape has the probability. Each hand is compared
with a single pad that makes as many touches at the places of the fingers, with offsets, forces and an observation model
of its own, and counts them as one action. Then whole searches are played, with poses by information gain.
"""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from activetouch import SCENES, Scene, TactileSensor, TouchWorld
from activetouch.distributions import Bodies, Uniform
from activetouch.hand import Hand
from activetouch.mesh_source import MeshSource
from activetouch.named_scenes import NamedScene
from activetouch.perception.grasps import GraspHypotheses
from activetouch.perception.reader import HypothesisTable
from activetouch.solids.mesh import Mesh
from belief.bayes import update
from belief.observation_model.rigid_body import RigidBodyModel
from belief.problem import SearchProblem, Touch
from belief.seeding import arrangement_rng, keyed_rng, touch_rng
from belief.statistics import wilson_interval
from belief.synthetic import sample_arrangement
from planners import make_decider, search

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
_RADIUS = 0.024  # of meshes [m]


def posteriors(sensor: TactileSensor, actions: Sequence[Sequence[int]], objects: int, seed: int) -> Floats:
    """Log posteriors after 0, 1, … actions in random order, ``(objects, actions + 1, K)``; shapes take turns."""
    scene, num_shapes = sensor.scene, len(sensor.shape_labels)
    prior = np.full(num_shapes, -np.log(num_shapes))
    found = np.empty((objects, len(actions) + 1, num_shapes))
    for number in range(objects):
        rng = keyed_rng([seed, number], is_fixed_length=True)
        obj, order = scene.sample_object(number % num_shapes, rng), rng.permutation(len(actions))
        evidence, found[number, 0] = sensor.model.start(), prior
        for step, action in enumerate(order, 1):
            poses = actions[action]
            images = [scene.press(obj, pose, touch_rng([seed, number], 0, pose, 0)).image for pose in poses]
            for touch in sensor.read(np.stack(images), poses):
                evidence = evidence.update(touch)
            found[number, step] = update(prior, evidence.log_likelihood)[0]
    return found


def forces_of(scene: Scene, grasps: int, seed: int) -> str:
    """Number of grasps with a finger that misses, and the largest force that the palm has to hold in the others."""
    assert scene.hand is not None
    rng, misses, held = np.random.default_rng(seed), 0, 0.0
    for number in range(grasps):
        obj = scene.sample_object(number % len(scene.shapes), rng)
        forces = [contact.force for contact in scene.press(obj, number % len(scene.poses), rng).contacts]
        misses += 0.0 in forces
        if 0.0 not in forces and len(forces) > 1:
            held = max(held, float(np.linalg.norm(scene.hand.net_force(forces))) / sum(forces))
    return f"{misses} of {grasps} grasps with a finger that misses, net force at most {held:.1%} in the others"


def ratio(numbers: Floats, of_one: Floats) -> str:
    """The ratio of two means of the same objects, with a 95 % bootstrap interval."""
    drawn = np.random.default_rng(0).integers(len(numbers), size=(2000, len(numbers)))
    low, high = np.quantile(numbers[drawn].mean(axis=1) / of_one[drawn].mean(axis=1), [0.025, 0.975])
    return f"{numbers.mean() / of_one.mean():.2f} [{low:.2f}, {high:.2f}]"


def right_words(right: Bools) -> str:
    """Fraction that is right, with a 95 % Wilson interval."""
    low, high = wilson_interval(int(right.sum()), len(right))
    return f"{right.mean():.3f} [{low:.3f}, {high:.3f}]"


def searches(sensor: TactileSensor, named: NamedScene, number: int, stated: float, seed: int) -> tuple[Floats, Bools]:
    """Actions of each search of a scene, stopped at probability ``stated``, and its success; targets take turns."""
    labels, many, model = sensor.shape_labels, named.num_objects, sensor.model
    limit = named.touches_per_object * many
    problem = SearchProblem(labels, sensor.pose_labels, many, named.composition, touch_limit=limit)
    name = f"information_gain(confirm={stated}, reject={1 - stated:.3f})"
    decider = make_decider(name, model.outcome_table(), model)
    actions, right = np.empty(number), np.empty(number, bool)
    for episode in range(number):
        target = episode % len(labels)
        key = (seed, target, episode)
        rng = arrangement_rng(key)
        world = TouchWorld.sample(sensor, sample_arrangement(problem, rng), rng)
        played = search(world, decider, problem, target, model, key)
        actions[episode], right[episode] = played.num_touches, played.success
    return actions, right


def scaled_meshes(folder: Path, number: int) -> dict[str, Mesh]:
    """Bodies of a folder, evenly chosen among its OBJ files, whose bounding balls have a radius of 24 mm."""
    files = sorted(folder.rglob("*.obj"))
    found = {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for index in np.linspace(0, len(files) - 1, number).round().astype(int):
            mesh = MeshSource.parse(f"{files[index]}@0.01").read()
            factor = _RADIUS / mesh.bounding_radius
            found[files[index].stem] = Mesh(files[index].stem, mesh.vertices * factor, mesh.faces)
    return found


class TravelOnly(GraspHypotheses):
    """Hypotheses that predict the fingers' travel and ignore the images."""

    def embedded(self, scene: Scene, bodies: Bodies, pose: int) -> NDArray[np.float32]:
        """See :class:`GraspHypotheses`."""
        found = super().embedded(scene, bodies, pose)
        found[..., : -len(self.hand) - 1] = 0.0
        return found


def travel_only(sensor: TactileSensor, seed: int, objects: int = 48) -> TactileSensor:
    """A sensor of a hand that reads travel, with a model of travel alone that is fitted to new grasps of objects."""
    scene, known = sensor.scene, sensor.reader.hypotheses
    assert isinstance(known, GraspHypotheses)
    reader = replace(sensor.reader, hypotheses=TravelOnly(known.single, scene, known.reach))
    rng, num_poses = np.random.default_rng([seed, 1]), len(scene.poses)
    shapes = np.repeat(np.arange(len(scene.shapes)), objects)
    things = [scene.sample_object(int(shape), rng) for shape in shapes]
    images = np.stack([scene.press(thing, pose, rng).image for thing in things for pose in range(num_poses)])
    read, poses = reader.read(images), np.tile(np.arange(num_poses), len(shapes))
    touches = [Touch(*touch) for touch in zip(poses.tolist(), read.logits, read.embeddings, strict=True)]
    table, ids = HypothesisTable(reader, scene), np.repeat(np.arange(len(shapes)), num_poses)
    labels: dict[str, Any] = {"shape_labels": scene.shape_labels, "num_poses": num_poses}
    model = RigidBodyModel.fit(touches, shapes[ids], ids, embed=table, num_hypotheses=known.number, **labels)
    return replace(sensor, reader=reader, model=model)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scene", default="coarse")
    parser.add_argument("--fingers", type=int, nargs="+", default=[1, 2, 3])
    parser.add_argument("--objects", type=int, default=400)
    parser.add_argument("--searches", type=int, default=400, help="0 for none")
    parser.add_argument("--stated", type=float, default=0.95)
    parser.add_argument("--offset", type=float, help="largest offset of a body in the palm, each way [m]")
    parser.add_argument("--latent", nargs="*", choices=["anew", "kept"], default=[], help="positions in the palm")
    parser.add_argument("--travel", type=float, help="standard deviation of measured travel [m]")
    parser.add_argument("--meshes", type=Path, help="folder of mesh files, which are scaled to one radius")
    parser.add_argument("--bodies", type=int, default=8, help="how many of the folder, evenly chosen")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    name, stated, seed, number = arguments.scene, arguments.stated, arguments.seed, arguments.objects
    named = SCENES[name]
    if arguments.meshes:
        named = replace(named, scene=replace(named.scene, shapes=scaled_meshes(arguments.meshes, arguments.bodies)))
    usual = named.scene
    if arguments.offset is not None:
        vary = replace(usual.variation, offset=Uniform(-arguments.offset, arguments.offset))
        named = replace(named, scene=replace(usual, variation=vary))
    hands = {m: Hand.around(m) for m in arguments.fingers}
    sensors = {m: TactileSensor.shipped(name, named.scene.with_hand(hand)) for m, hand in hands.items()}
    rows: list[tuple[str, TactileSensor, list[tuple[int, ...]]]] = []
    num_poses = len(named.scene.poses)
    each: list[tuple[int, ...]] = [(pose,) for pose in range(num_poses)]
    for m, sensor in sensors.items():
        rows.append((f"{m} fingers", sensor, each))
        if m > 1 and not (arguments.latent or arguments.travel or arguments.meshes):
            places = {f"{p} {i}": r for i, one in enumerate(sensor.scene.fingers) for p, r in one.rotations.items()}
            pad = TactileSensor.shipped(name, replace(sensor.scene, hand=Hand.one_finger(), poses=places))
            rows.append(
                (f"{m} single touches", pad, [tuple(range(p, m * num_poses, num_poses)) for p in range(num_poses)])
            )
        if arguments.latent:
            unknowing = TactileSensor.shipped(name, usual.with_hand(hands[m]))
            rows.append((f"{m} fingers, belief of 2 mm", replace(unknowing, scene=sensor.scene), each))
        for offset in arguments.latent:
            latent = TactileSensor.shipped(name, named.scene.with_hand(replace(hands[m], offset=offset)))
            if offset == "kept":
                rows.append((f"{m} fingers, averaged where it is kept", replace(sensor, scene=latent.scene), each))
            rows.append((f"{m} fingers, latent {offset}", latent, each))
        if arguments.travel is not None:
            reads = TactileSensor.shipped(name, named.scene.with_hand(replace(hands[m], travel=arguments.travel)))
            rows += [
                (f"{m} fingers and travel", reads, each),
                (f"{m} fingers, travel only", travel_only(reads, seed), each),
            ]
    print(
        f"{name}: {number} objects named at {stated:g}, palm poses in random order; {named.scene.variation.offset} m\n"
    )
    print(
        "| an action | to a stated share | ratio [95 %] | right at stops | stated there | nats after 1, 2, 3 actions |"
    )
    print("|---|---:|---|---|---:|---|")
    of_one: Floats | None = None
    for what, sensor, actions in rows:
        log_probs = posteriors(sensor, actions, number, seed)
        truth, leading = np.arange(number) % len(sensor.shape_labels), log_probs.max(axis=2)
        reached = np.hstack([leading[:, :-1] >= np.log(stated), np.ones((number, 1), bool)])
        at = reached.argmax(axis=1)
        right, said = log_probs[np.arange(number), at].argmax(axis=1) == truth, np.exp(leading[np.arange(number), at])
        of_one = at.astype(float) if of_one is None else of_one
        nats = (log_probs[np.arange(number), 1:4, truth] + np.log(len(sensor.shape_labels))).mean(axis=0)
        told = ", ".join(f"{nat:.3f}" for nat in nats)
        print(f"| {what} | {at.mean():.2f} | {ratio(at, of_one)} | {right_words(right)} | {said.mean():.3f} | {told} |")
    if arguments.searches:
        print(f"\n{arguments.searches} searches, poses by information gain, confirm at {stated:g}\n")
        print("| hand | actions | ratio [95 %] | success |\n|---|---:|---|---|")
        of_one = None
        for m, sensor in sensors.items():
            spent, right = searches(sensor, named, arguments.searches, stated, seed)
            of_one = spent if of_one is None else of_one
            print(f"| {m} fingers | {spent.mean():.2f} | {ratio(spent, of_one)} | {right_words(right)} |")
    print()
    for m, sensor in sensors.items():
        print(f"{m} fingers: {forces_of(sensor.scene, 1000, seed)}")


if __name__ == "__main__":
    main()
