"""How much of the accuracy comes from the force and depth of a press instead of its geometry.

python -m benchmarks.leak --scene paper

The accuracy of the classifier is compared with:

* predictions from force, from depth and from both, without an image;
* its accuracy on *exchanged* images, which show the geometry of one touch with the force and depth of another. They are
  scored with the shape of the geometry (force and depth are shuffled) and with the other shape (geometry is removed).
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
from numpy.typing import NDArray

from activetouch.pressing.contact import Contact
from activetouch.pressing.pad import Pad
from activetouch.rendering import read_out
from activetouch.scene import Scene
from belief.claims import claim_folder, ends_claims
from belief.files import write_text
from belief.seeding import keyed_rng
from belief.statistics import paired_bootstrap
from belief.table import Table, interval
from benchmarks.neighbours import neighbour_guesses
from experiments.command_line.arguments import Jobs, Seed, Within, check_arguments
from experiments.parallel import default_jobs, run_tasks
from experiments.scene_choice import SceneChoice, in_file_names
from experiments.sensor.scores import accuracy_of_objects
from experiments.sensor_choice import open_sensor

Floats = NDArray[np.float64]
Images = NDArray[np.uint8]
Integers = NDArray[np.int64]
Key = tuple[int, int]

PLAIN, SHUFFLED, REMOVED = "touch as it is", "force and depth of another touch", "geometry of another touch"
NO_IMAGE, CLASSIFIER = "nearest neighbours, no image", "classifier"
_PER_TASK = 48
_KEY = 0x1EAF  # so that generators differ from those of collections and episodes with the same seed
_TEST, _INTERVALS = 0, 2


@dataclass(frozen=True, eq=False)
class Exchanged:
    """N touches, each with what is read of its own image and of an exchanged image.

    Attributes:
        shapes: of the objects, ``(N,)``.
        object_ids: of the touches, ``(N,)``.
        lenders: the touches that give force and depth to the exchanged images, a permutation, ``(N,)``.
        numbers: force [N] and depth [m], ``(N, 2)``.
        plain: readings of the own images, ``(N, ...)``.
        lent: readings of the exchanged images.
    """

    shapes: Integers
    object_ids: Integers
    lenders: Integers
    numbers: Floats
    plain: NDArray[Any]
    lent: NDArray[Any]


@dataclass(frozen=True)
class Leak:
    """Measure how well force and depth predict the shape, and how much of the classifier's accuracy comes from them."""

    choice: Annotated[SceneChoice, tyro.conf.arg(name="")] = field(default_factory=SceneChoice)
    """The world."""
    sensor: Path | None = None
    """Folder of a sensor, or name of a shipped one; the scene's by default."""
    objects: Annotated[int, Within(2, 10**8)] = 150
    """Number of objects of every shape to measure on; each is touched once in every pose."""
    seed: Seed = 0
    """Seed of objects, presses, exchange and intervals."""
    out: Path | None = None
    """Folder for leak.json and leak.md; runs/leak-SCENE by default."""
    jobs: Jobs = field(default_factory=default_jobs)
    """Number of processes that press; the results do not depend on it."""

    @ends_claims
    def run(self) -> None:
        """Touch, classify, print and write."""
        check_arguments(self)
        scene = self.choice.named.scene
        out = self.out if self.out is not None else Path(f"runs/leak-{in_file_names(self.choice.scene)}")
        claim_folder(out)
        classifier = open_sensor(self.sensor, self.choice).reader
        touched = exchange(
            scene, self.objects, (self.seed, _TEST), lambda images: classifier.read(images).labels, self.jobs
        )
        shares = {
            NO_IMAGE: shares_without_image(touched.numbers, touched.shapes, touched.object_ids),
            CLASSIFIER: judged(touched, touched.plain, touched.lent),
        }
        rng = keyed_rng([self.seed, _KEY, _INTERVALS], is_fixed_length=True)
        result = {
            "scene": self.choice.to_dict(),
            "renderer": repr(scene.renderer),
            "sensor": str(self.sensor or self.choice.scene),
            "seed": self.seed,
            "objects_per_shape": self.objects,
            "num_objects": self.objects * len(scene.shapes),
            "num_touches": len(touched.shapes),
            "chance": 1 / len(scene.shapes),
            "accuracy": {
                who: {shown: accuracy_of_objects(right, np.arange(len(right)), rng) for shown, right in rights.items()}
                for who, rights in shares.items()
            },
            "differences": {
                f"{CLASSIFIER}: {PLAIN} − {name}": paired_bootstrap(shares[CLASSIFIER][PLAIN], other, rng)
                for name, other in (
                    (SHUFFLED, shares[CLASSIFIER][SHUFFLED]),
                    ("no image, force and depth", shares[NO_IMAGE]["force and depth"]),
                )
            },
        }
        _write(result, out)


def exchange(
    scene: Scene, num_objects: int, key: Key, read: Callable[[Images], NDArray[Any]], jobs: int = 1
) -> Exchanged:
    """Touch new objects in every pose, and read the own and the exchanged images.

    Args:
        scene: the world.
        num_objects: of every shape.
        key: seed and stream of the generators.
        read: from images ``(n, ...)`` to n rows.
        jobs: number of processes that press.
    """
    touches = np.arange(num_objects * len(scene.shapes) * len(scene.poses))
    lenders = keyed_rng([*key, _KEY], is_fixed_length=True).permutation(len(touches))
    tasks = [
        partial(_touch_some, scene, key, touches[first : first + _PER_TASK], lenders[first : first + _PER_TASK])
        for first in range(0, len(touches), _PER_TASK)
    ]
    parts = [
        (first, numbers, read(plain), read(lent))
        for first, numbers, plain, lent in run_tasks(tasks, jobs, "touching, each touch for itself and with a lender")
    ]
    columns = list(zip(*sorted(parts, key=lambda part: part[0]), strict=True))[1:]
    object_ids = touches // len(scene.poses)
    return Exchanged(object_ids % len(scene.shapes), object_ids, lenders, *map(np.concatenate, columns))


def _touch_some(scene: Scene, key: Key, touches: Integers, lenders: Integers) -> tuple[int, Floats, Images, Images]:
    numbers: list[tuple[float, float]] = []
    plain: list[Any] = []
    lent: list[Any] = []
    for touch, lender in zip(touches.tolist(), lenders.tolist(), strict=True):
        (contact, stiffness), (other, _) = _press(scene, key, touch), _press(scene, key, lender)
        numbers.append((contact.force, contact.depth))
        for images, shown in ((plain, contact), (lent, with_numbers_of(other, contact, stiffness))):
            images.append(read_out(scene.image(shown), scene.faults, keyed_rng([*key, _KEY, touch, 1])))
    return int(touches[0]), np.array(numbers), np.stack(plain), np.stack(lent)


def _press(scene: Scene, key: Key, touch: int) -> tuple[Contact, float]:
    """The contact with a number and the stiffness of its object; equal arguments give equal results."""
    number, pose = divmod(touch, len(scene.poses))
    thing = scene.sample_object(number % len(scene.shapes), keyed_rng([*key, _KEY, number, 2]))
    rng = keyed_rng([*key, _KEY, touch, 3])
    return scene.press(thing, pose, rng).contact, thing.stiffness


def with_numbers_of(lender: Contact, contact: Contact, stiffness: float = 1.0) -> Contact:
    """A control for experiments: a contact with the force and depth of another contact.

    The result is not physical, because this surface would need another force for that depth. The forces of a trace are
    scaled; their points stay.

    Args:
        lender: gives force and depth.
        contact: gives the gap, and the points of its trace.
        stiffness: of the layer and the object's skin together, relative to the pad's, for this contact.

    Raises:
        ValueError: the lender is deeper than the contact's layer.
    """
    shown = contact_at_depth(contact.pad, contact.gap, lender.depth, stiffness)
    trace, held = contact.trace, _held_force(contact)
    if trace is not None and held > 0.0:
        trace = replace(trace, force=trace.force * (_held_force(lender) / held))
    return replace(shown, force=lender.force, trace=trace)


def contact_at_depth(pad: Pad, gap: Floats, depth: float, stiffness: float = 1.0) -> Contact:
    """The contact whose deepest taxel is indented by ``depth``, the inverse of :func:`elastic_contact`.

    Args:
        pad: the pad.
        gap: from :func:`activetouch.pressing.contact.surface_gap`.
        depth: of the deepest taxel, in ``[0, pad.max_depth]`` [m].
        stiffness: of the layer and the object's skin together, relative to the pad's.

    Raises:
        ValueError: the depth is outside its range.
    """
    if not 0.0 <= depth <= pad.max_depth:
        raise ValueError(f"depth must be in [0, {pad.max_depth:g}] m, the thickness of the layer; got {depth:g}")
    indentation = np.maximum(depth - gap, 0.0)
    pressure = (stiffness * pad.stiffness) * indentation
    return Contact(pad, gap, float(pressure.sum()) * pad.taxel_area, indentation, pressure)


def _held_force(contact: Contact) -> float:
    """Magnitude of the force at the end of the pause [N]; it includes friction if there is a trace."""
    if contact.trace is None:
        return contact.force
    return float(np.linalg.norm(contact.trace.force[contact.trace.end_of_pause - 1])) if contact.force else 0.0


def judged(touched: Exchanged, plain: Integers, lent: Integers) -> dict[str, Floats]:
    """Fraction of correct predictions for every object, by kind of image.

    Args:
        touched: the touches.
        plain: shapes predicted from the own images, ``(N,)``.
        lent: shapes predicted from the exchanged images, ``(N,)``.
    """
    shapes, ids, lenders = touched.shapes, touched.object_ids, touched.lenders
    return {
        PLAIN: share_by_object(plain == shapes, ids),
        SHUFFLED: share_by_object(lent == shapes, ids),
        REMOVED: share_by_object(lent == shapes[lenders], ids[lenders]),
    }


def cross_fitted_guesses(numbers: Floats, shapes: Integers, object_ids: Integers, num_folds: int = 5) -> Integers:
    """The shape of every touch, guessed from the touches of other objects: nobody is asked about their own.

    The objects are split into folds, and those of one guessed by the votes of √n among the n touches of the others.

    Args:
        numbers: what is known of each touch, ``(N, D)``.
        shapes: true ones, ``(N,)``.
        object_ids: of the objects touched, ``(N,)``.
        num_folds: at most one for every object.

    Returns:
        ``(N,)``.

    Raises:
        ValueError: there are no two objects.
    """
    objects, rank = np.unique(object_ids, return_inverse=True)
    if len(objects) < 2:
        raise ValueError(f"need touches of at least two objects to guess one from the others, got {len(objects)}")
    folds = min(num_folds, len(objects))
    fold = rank * folds // len(objects)
    guesses = np.empty_like(shapes)
    for number in range(folds):
        test = fold == number
        num_neighbours = max(1, math.isqrt(np.count_nonzero(~test)))
        guesses[test] = neighbour_guesses(numbers[~test], shapes[~test], numbers[test], num_neighbours)
    return guesses


def share_by_object(right: NDArray[np.bool_], object_ids: Integers) -> Floats:
    """Share of right guesses for every object, in order of its id; what a bootstrap of objects resamples.

    Args:
        right: whether the guess of a touch was, ``(N,)``.
        object_ids: of the objects touched, ``(N,)``.
    """
    _, rank = np.unique(object_ids, return_inverse=True)
    return np.bincount(rank, right) / np.bincount(rank)


def shares_without_image(numbers: Floats, shapes: Integers, object_ids: Integers) -> dict[str, Floats]:
    """Share of right guesses for every object from its touches' force, from their depth, and from both.

    Args:
        numbers: force and depth of each touch, ``(N, 2)``.
        shapes: true ones, ``(N,)``.
        object_ids: of the objects touched, ``(N,)``.
    """
    known = {"force": numbers[:, :1], "depth": numbers[:, 1:], "force and depth": numbers}
    return {
        name: share_by_object(cross_fitted_guesses(columns, shapes, object_ids) == shapes, object_ids)
        for name, columns in known.items()
    }


def _write(result: dict[str, Any], out: Path) -> None:
    """Print the result, and write it as JSON and Markdown."""
    measured = Table(
        "Fraction of correct answers",
        ("reader", "images", "correct [95 %]"),
        [
            (who, shown, interval(*right))
            for who, rights in result["accuracy"].items()
            for shown, right in rights.items()
        ],
    )
    compared = Table(
        "Differences",
        ("difference", "correct [95 %]"),
        [(name, interval(*difference, spec="+.3f")) for name, difference in result["differences"].items()],
    )
    heading = (
        f"{result['scene']['scene']}, {result['renderer']}, seed {result['seed']}: fraction of correct "
        f"answers for {result['num_touches']} touches of {result['num_objects']} objects; intervals resample objects. "
        f"Chance is {result['chance']:.3f}. With the geometry of another touch, the correct shape is that of the touch "
        "that gives force and depth."
    )
    write_text(out / "leak.json", json.dumps(result, indent=1) + "\n")
    write_text(out / "leak.md", "\n\n".join([heading, measured.markdown(), compared.markdown()]) + "\n")
    print(heading, measured, compared, sep="\n\n")
    print(f"wrote leak.json and leak.md into {out}")


if __name__ == "__main__":
    tyro.cli(Leak, config=(tyro.conf.OmitSubcommandPrefixes,)).run()
