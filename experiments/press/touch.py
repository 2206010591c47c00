"""``activetouch touch``: draw presses of a scene, their motion, or log every time step."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeAlias

import numpy as np
import tyro
from numpy.typing import NDArray

from activetouch.poses import Placement, Quaternion
from activetouch.pressing.dynamic import GuardedMove
from activetouch.rendering import RENDERERS
from activetouch.scene import Scene
from belief.constraints import Ending
from belief.files import atomic_path, ends_claims, require_writable_file
from belief.seeding import keyed_rng
from experiments.command_line.arguments import BadArgument, Count, Picture, Seed, check_arguments
from experiments.parallel import progress_bar
from experiments.scene_choice import SceneChoice

if TYPE_CHECKING:
    from activetouch.pressing.closing import Gripper
    from activetouch.pressing.contact import Contact, Grasp, Press, Trace

Row: TypeAlias = list[int | str]
LOG_COLUMNS = ("press", "time", "phase", "x", "y", "z", "fx", "fy", "fz", "qw", "qx", "qy", "qz")
"""Number of the press; time [s] in it and phase; position [m], force of the pad [N] and orientation of the object."""


def press_new_object(scene: Scene, shape: str, pose: str, seed: int) -> tuple[Placement, Contact]:
    """Placement and contact of one press of a new random object; raises UnknownName for its shape or the pose."""
    return next(presses_of_new_object(scene, shape, pose, seed))


def presses_of_new_object(scene: Scene, shape: str, pose: str, seed: int) -> Iterator[tuple[Placement, Contact]]:
    """Placements and contacts of press after press of one new random object, without an end."""
    rng = np.random.default_rng(seed)
    pressed = scene.sample_object(shape, rng)
    while True:
        found = scene.press(pressed, pose, rng)
        yield found.placement, found.contact


def close_hand(
    scene: Scene, shape: str, pose: str, seed: int, menagerie: Path | None = None
) -> tuple[Gripper, Grasp, list[NDArray[np.float64]]]:
    """Close the scene's hand, or Menagerie's Allegro hand, on a new random object, step by step in MuJoCo."""
    from activetouch.pressing.allegro import ALLEGRO_LAW, ALLEGRO_PAD, AllegroFingers  # these load MuJoCo
    from activetouch.pressing.closing import Closing, SlidingPads

    hand, rng = scene.hand, np.random.default_rng(seed)
    assert hand is not None
    in_palm, depth = scene.place_in_palm(scene.sample_object(shape, rng), pose, rng)
    force, law, states = scene.variation.force.sample(rng), Closing(), list[NDArray[np.float64]]()
    if menagerie is not None:
        law, forces = ALLEGRO_LAW, np.full(len(hand), force)
        gripper: Gripper = AllegroFingers(law, menagerie, ALLEGRO_PAD, in_palm, depth)
    else:
        centre, forces = np.array([depth, *in_palm.offset]), force * hand.forces
        gripper = SlidingPads(law, scene.pad, hand.placements(in_palm, depth), hand.rotations, centre)
    grasp = law.settle(gripper, in_palm, forces, lambda _, data: states.append(data.qpos.copy()))
    return gripper, grasp, states


def press_all(scene: Scene, seed: int) -> Mapping[tuple[str, str, str], NDArray[np.float64]]:
    """Images of an object of every shape in every pose by every renderer, by (shape, renderer, pose)."""
    images: dict[tuple[str, str, str], NDArray[np.float64]] = {}
    with progress_bar() as progress:
        for shape_index, shape in enumerate(progress.track(scene.shape_labels, description="pressing")):
            pressed = scene.sample_object(shape_index, keyed_rng([seed, shape_index], is_fixed_length=True))
            for pose_index, pose in enumerate(scene.pose_labels):
                rng = keyed_rng([seed, shape_index, pose_index], is_fixed_length=True)
                contact = scene.press(pressed, pose_index, rng).contact
                images |= {(shape, name, pose): renderer(contact) for name, renderer in RENDERERS.items()}
    return images


@dataclass(frozen=True)
class TouchCommand:
    """Draw one press: the scene, the height map, the images of three renderers, and the force over time.

    A log (--csv) has a row for every time step: press, time [s], phase (approach, contact, pause, withdraw, rotate),
    position x, y, z of the object [m], force fx, fy, fz of the pad on it [N], and its orientation qw, qx, qy, qz.

    For example:

        activetouch touch --shape cone --pose corner --out cone.png
        activetouch touch --scene paper --seed 3
        activetouch touch --all --out gallery.png
        activetouch touch --scene paper --presentation resampled --presses 10 --csv cone.csv --shape cone
        activetouch touch --pad mine.toml --shape cube --out taxels.png
        activetouch touch --scene coarse --hand three_finger --view grasp.webp
        activetouch touch --scene coarse --hand allegro --menagerie mujoco_menagerie --out grasp.png
    """

    choice: Annotated[SceneChoice, tyro.conf.arg(name="")] = field(default_factory=SceneChoice)
    """The world."""
    shape: str | None = None
    """Label of the shape to press; the scene's first by default."""
    pose: str | None = None
    """Label of the pose; the scene's first by default."""
    all: bool = False
    """Draw the images of every shape in every pose by every renderer instead."""
    view: Annotated[Path | None, Ending((".gif", ".webp"))] = None
    """Write the motion instead, into a file that ends in .gif or .webp."""
    csv: Annotated[Path | None, Ending((".csv",))] = None
    """Write every time step of the presses instead, into a file that ends in .csv."""
    presses: Count = 1
    """Presses of the object in a log; --presentation resampled turns it between them, as the paper does."""
    seed: Seed = 0
    """Seed of the objects' sizes and orientations and of the presses."""
    out: Picture = Path("runs/touch.png")
    """File for the picture; the ending decides the format."""

    @ends_claims
    def run(self) -> None:
        """Press, and draw or write."""
        check_arguments(self)
        choice, path = self.choice, self.view or self.csv or self.out
        hand = choice.menagerie if choice.hand == "allegro" and choice.robot is None else None
        scene = (choice if hand is None else replace(choice, menagerie=None)).named.scene
        shape, pose = self.shape or scene.shape_labels[0], self.pose or scene.pose_labels[0]
        if self.all + (self.view is not None) + (self.csv is not None) > 1:
            raise BadArgument("--all, --view and --csv are different outputs; give one of them")
        if self.presses > 1 and self.csv is None:
            raise BadArgument("--presses is the number of presses in a log; add --csv FILE.csv")
        if scene.hand is not None and (self.all or self.csv is not None or len(scene.hand) == 1):
            raise BadArgument("--hand draws a grasp of several fingers into --out FILE or --view FILE.webp alone")
        require_writable_file(path)
        if scene.hand is not None:
            self._grasp(scene, shape, pose, hand)
        else:
            self._press(replace(scene, press_model=scene.press_model.with_trace()), shape, pose)
        print(f"wrote {path}")

    def _press(self, scene: Scene, shape: str, pose: str) -> None:
        """Press objects, and draw or animate that."""
        from activetouch.view import press_motion, press_picture

        if scene.pad.layout is not None:
            return self._taxels(scene, shape, pose)
        from experiments.press.figures import draw_gallery, draw_touch

        if self.all:
            return draw_gallery(press_all(scene, self.seed), scene.pose_labels, self.out)
        presses = presses_of_new_object(scene, shape, pose, self.seed)
        if self.csv is not None:
            return write_log((next(presses) for _ in range(self.presses)), self.csv, scene.press_model)
        placement, contact = next(presses)
        around = scene.around(placement.shape)
        if self.view is not None:
            return press_motion(self.view, scene.pad, placement, _trace(contact), around)
        title = f"a {shape} in pose {pose}: {contact.force:.2f} N, {1e3 * contact.depth:.2f} mm deep"
        view = press_picture(scene.pad, placement, contact.depth, around)
        return draw_touch(title + " (bottomed out)" * contact.is_bottomed_out, view, contact, self.out)

    def _taxels(self, scene: Scene, shape: str, pose: str) -> None:
        """Press an object on a described pad; draw and print what its taxels read."""
        from activetouch.view import press_picture
        from experiments.press.figures import draw_taxels

        if self.all or self.view is not None or self.csv is not None:
            raise BadArgument("--pad draws one press into --out FILE; leave out --all, --view and --csv")
        taxels, rng = scene.pad.layout, np.random.default_rng(self.seed)
        assert taxels is not None, "asked before"
        pressed = scene.press(scene.sample_object(shape, rng), pose, rng)
        contact, readings = pressed.contact, taxels.mean(pressed.image / 255.0)
        felt, place = int((readings > 0.0).sum()), 1e3 * contact.centre_of_pressure
        lines = [
            f"a {shape} in pose {pose}: {contact.force:.2f} N, {1e3 * contact.depth:.2f} mm deep"
            + " (bottomed out)" * contact.is_bottomed_out,
            f"{felt} of {len(readings)} taxels feel it; taxel {readings.argmax()} reads the most, {readings.max():.2f}",
            f"centre of pressure: y = {place[0]:.1f} mm, z = {place[1]:.1f} mm",
        ]
        print("\n".join(lines))
        view = press_picture(scene.pad, pressed.placement, contact.depth)
        draw_taxels(lines[0], view, contact, pressed.image, self.out)

    def _grasp(self, scene: Scene, shape: str, pose: str, menagerie: Path | None) -> None:
        """Close the hand, or the Allegro hand of a copy of Menagerie, and draw or animate it."""
        from activetouch.view import cast_rays, write_motion
        from experiments.press.figures import draw_grasp

        gripper, grasp, states = close_hand(scene, shape, pose, self.seed, menagerie)
        middle, distance = np.array(gripper.camera[0]), gripper.camera[1]
        if self.view is not None:
            return write_motion(self.view, gripper.model, states, middle, distance)
        images = [np.asarray(scene.image(contact), float) for contact in grasp.contacts]
        forces = ", ".join(f"{contact.force:.1f}" for contact in grasp.contacts)
        view = cast_rays(gripper.model, gripper.data, middle, distance)
        return draw_grasp(f"a {shape} in pose {pose}: {forces} N", view, images, self.out)


def write_log(presses: Iterable[tuple[Placement, Contact]], path: Path, press_model: Press) -> None:
    """Write every time step of presses as CSV (paper §5.4); raises BadArgument if nothing moves in them."""
    before = None
    with atomic_path(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(LOG_COLUMNS)
        for number, (placement, contact) in enumerate(presses):
            trace, here = _trace(contact), placement.orientation
            if isinstance(press_model, GuardedMove) and before is not None and (before[0] != here).any():
                writer.writerows(_rotation(number - 1, *before, here, press_model))
            for time, phase, position, force in zip(trace.time, trace.phase, trace.position, trace.force, strict=True):
                writer.writerow(_log_row(number, time, phase.value, [*position, *force], here))
            before = here, trace


def _rotation(number: int, before: Quaternion, trace: Trace, after: Quaternion, press: GuardedMove) -> Iterator[Row]:
    """The last phase of a press, in which the object turns where it starts (paper §5.3)."""
    from scipy.spatial.transform import Rotation, Slerp

    step = trace.time[-1] - trace.time[-2]
    times = step * np.arange(1, round(press.rotation_time / step) + 1)
    turned = Slerp([0.0, times[-1]], Rotation.from_quat([before, after], scalar_first=True))(times)
    place = [max(press.start, trace.position[-1, 0]), *trace.position[-1, 1:], 0.0, 0.0, 0.0]
    for time, rotation in zip(times, turned.as_quat(scalar_first=True), strict=True):
        yield _log_row(number, trace.time[-1] + time, "rotate", place, rotation)


def _log_row(number: int, time: float, phase: str, numbers: list[float], turned: Quaternion) -> Row:
    """The text of a row of a log."""
    return [number, f"{time:.9g}", phase, *(f"{one:.9g}" for one in numbers), *(f"{part:.6f}" for part in turned)]


def _trace(contact: Contact) -> Trace:
    """The time series of a press."""
    if contact.trace is None:
        raise BadArgument(
            "nothing moves in a quasistatic press, which has no time; choose --fidelity dynamic or guarded_move"
        )
    return contact.trace
