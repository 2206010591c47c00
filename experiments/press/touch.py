"""``activetouch touch``: look at presses of a scene in a picture, in a window, or as a table of every time step."""

from __future__ import annotations

import itertools
import time
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Annotated

import numpy as np
import tyro
from numpy.typing import NDArray
from rich.progress import track

from activetouch.errors import WrongPress
from activetouch.placement import Placement
from activetouch.poses import random_orientation
from activetouch.pressing.trace import Trace, join, write_csv
from activetouch.rendering import RENDERERS
from activetouch.scene import Scene, WorldObject
from belief.claims import claim_folder, ends_claims
from belief.errors import MissingPackage, install_command
from belief.files import in_file_name, require_writable_file
from belief.seeding import keyed_rng
from experiments.command_line.arguments import BadArgument, Ending, Picture, Seed, check_arguments
from experiments.scene_choice import SceneChoice

if TYPE_CHECKING:
    from activetouch.pressing.closing import Gripper
    from activetouch.pressing.contact import Contact
    from activetouch.pressing.press import Grasp

_CYCLES = 10  # presses of each object in a table


def traced(scene: Scene) -> Scene:
    """The scene with a trace of its presses, if they can record one."""
    return replace(scene, press_model=scene.press_model.with_trace())


def press_new_object(scene: Scene, shape: str, pose: str, seed: int) -> tuple[Placement, Contact]:
    """Placement and contact of one press of a new random object.

    Args:
        scene: the world.
        shape: label of the object's shape.
        pose: label of the pose.
        seed: of the object's size and orientation and of the press.

    Raises:
        UnknownName: the scene has no such shape or pose.
    """
    rng = np.random.default_rng(seed)
    pressed = scene.press(scene.sample_object(shape, rng), pose, rng)
    return pressed.placement, pressed.contact


def close_hand(
    scene: Scene, shape: str, pose: str, seed: int, menagerie: Path | None = None
) -> tuple[Gripper, Grasp, list[NDArray[np.float64]]]:
    """Close the hand of a scene on a new random object, step by step in MuJoCo.

    Args:
        scene: the world, with a hand.
        shape: label of the object's shape.
        pose: label of the pose.
        seed: of the object's size and orientation and of the grasp.
        menagerie: a copy of MuJoCo Menagerie, whose Allegro hand closes instead of pads that slide.

    Returns:
        The model, what the fingers feel, and the positions of its joints in every step.

    Raises:
        UnknownName: the scene has no such shape or pose.
        FileNotFoundError: the menagerie has no Allegro hand.
        UnstablePress: the forces do not settle.
    """
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
        gripper = SlidingPads(law, scene.setup, hand.placements(in_palm, depth), hand.rotations, centre)
    grasp = law.settle(gripper, in_palm, forces, lambda _, data: states.append(data.qpos.copy()))
    return gripper, grasp, states


def press_all(scene: Scene, seed: int) -> Mapping[tuple[str, str, str], NDArray[np.float64]]:
    """Images of an object of every shape in every pose by every renderer, by (shape, renderer, pose).

    Args:
        scene: the world.
        seed: of the objects and their presses.
    """
    images: dict[tuple[str, str, str], NDArray[np.float64]] = {}
    for shape_index, shape in enumerate(track(scene.shape_labels, "pressing")):
        pressed = scene.sample_object(shape_index, keyed_rng([seed, shape_index], is_fixed_length=True))
        for pose_index, pose in enumerate(scene.pose_labels):
            rng = keyed_rng([seed, shape_index, pose_index], is_fixed_length=True)
            contact = scene.press(pressed, pose_index, rng).contact
            images |= {(shape, name, pose): renderer(contact) for name, renderer in RENDERERS.items()}
    return images


def write_presses(scene: Scene, seed: int, folder: Path, num_cycles: int = _CYCLES) -> None:
    """Press an object of each shape repeatedly and write every step, one CSV file per object (paper §5.4).

    Args:
        scene: its presses must simulate rotations, as guarded moves do.
        seed: of the objects and their presses.
        folder: for the files, which exists.
        num_cycles: presses of each object.

    Raises:
        WrongPress: the scene's presses do not simulate rotations.
    """
    for shape_index, shape in enumerate(track(scene.shape_labels, "pressing")):
        rng = keyed_rng([seed, shape_index], is_fixed_length=True)
        cycles = record_cycles(scene, scene.sample_object(shape_index, rng), num_cycles, rng)
        write_csv(folder / f"{in_file_name(shape, '-')}.csv", cycles)


@dataclass(frozen=True)
class TouchCommand:
    """Draw one press: the scene, the height map, the images of three renderers, and the force over time.

    A table from --csv has the columns cycle, time [s], position x, y, z [m], force fx, fy, fz [N] and phase (approach,
    contact, pause, withdraw, rotate), for ten presses of an object of each shape. Only the scene "paper" and others
    with guarded moves rotate objects, as a table needs.

    For example:

        activetouch touch --shape cone --pose corner --out cone.png
        activetouch touch --scene paper --seed 3
        activetouch touch --all --out gallery.png
        activetouch touch --scene coarse --hand three_finger --view grasp.webp
        activetouch touch --scene coarse --hand allegro --menagerie mujoco_menagerie --out grasp.png
        activetouch touch --scene paper --csv runs/log
    """

    choice: Annotated[SceneChoice, tyro.conf.arg(name="")] = field(default_factory=SceneChoice)
    """The world."""
    shape: str | None = None
    """Label of the shape to press; the scene's first by default."""
    pose: str | None = None
    """Label of the pose; the scene's first by default."""
    all: bool = False
    """Draw the images of every shape in every pose by every renderer instead."""
    view: Annotated[Path | None, Ending(("", ".gif", ".webp"))] = None
    """Show the motion instead: a file that ends in .gif or .webp for an animation, or the word window for MuJoCo's
    window, which needs the extra "viewer" and a display."""
    menagerie: Path | None = None
    """A copy of MuJoCo Menagerie, whose Allegro hand closes instead of pads that slide, with --hand allegro."""
    csv: Path | None = None
    """Write presses as time series into this folder instead, one CSV file for an object of each shape."""
    seed: Seed = 0
    """Seed of the objects' sizes and orientations and of the presses."""
    out: Picture = Path("runs/touch.png")
    """File for the picture; the ending decides the format."""

    @ends_claims
    def run(self) -> None:
        """Press, and draw, show or write."""
        check_arguments(self)
        if self.all + (self.view is not None) + (self.csv is not None) > 1:
            raise BadArgument("--all, --view and --csv are different outputs; give one of them")
        window = self.view is not None and not self.view.suffix
        if self.menagerie is not None and self.choice.hand != "allegro":
            raise BadArgument("--menagerie gives the model of an Allegro hand; add --hand allegro")
        if self.choice.named.scene.hand is not None:
            if self.all or window or self.csv is not None or len(self.choice.named.scene.hand) == 1:
                raise BadArgument("--hand draws a grasp of several fingers into --out FILE or --view FILE.webp alone")
            self._grasp(self.choice.named.scene)
            return
        if self.csv is not None:
            claim_folder(self.csv)
            write_presses(self.choice.named.scene, self.seed, self.csv)
            print(f"wrote {len(self.choice.named.scene.shapes)} files to {self.csv}")
            return
        if not window:
            require_writable_file(self.view or self.out)
        scene = traced(self.choice.named.scene)
        if self.all:
            from experiments.press.figures import draw_gallery

            draw_gallery(press_all(scene, self.seed), scene.pose_labels, self.out)
        else:
            shape, pose = self.shape or scene.shape_labels[0], self.pose or scene.pose_labels[0]
            placement, contact = press_new_object(scene, shape, pose, self.seed)
            if self.view is not None:
                show_press(scene, placement, contact, None if window else self.view)
                return
            from activetouch.view.picture import press_picture
            from experiments.press.figures import draw_touch

            title = f"a {shape} in pose {pose}: {contact.force:.2f} N, {1e3 * contact.depth:.2f} mm deep"
            view = press_picture(scene.setup, placement, contact.depth)
            draw_touch(title + " (bottomed out)" * contact.is_bottomed_out, view, contact, self.out)
        print(f"wrote {self.out}")

    def _grasp(self, scene: Scene) -> None:
        """Close the hand, and draw or animate it."""
        from activetouch.view.picture import cast_rays, write_motion
        from experiments.press.figures import draw_grasp

        path = self.view or self.out
        require_writable_file(path)
        shape, pose = self.shape or scene.shape_labels[0], self.pose or scene.pose_labels[0]
        gripper, grasp, states = close_hand(scene, shape, pose, self.seed, self.menagerie)
        middle, distance = np.array(gripper.camera[0]), gripper.camera[1]
        if self.view is not None:
            write_motion(path, gripper.model, states, middle, distance)
        else:
            images = [np.asarray(scene.image(contact), float) for contact in grasp.contacts]
            forces = ", ".join(f"{contact.force:.1f}" for contact in grasp.contacts)
            view = cast_rays(gripper.model, gripper.data, middle, distance)
            draw_grasp(f"a {shape} in pose {pose}: {forces} N", view, images, path)
        print(f"wrote {path}")


def show_press(scene: Scene, placement: Placement, contact: Contact, path: Path | None = None) -> None:
    """Show a press in MuJoCo's window until it is closed, or write it as an animation.

    Args:
        scene: the world.
        placement: of the object.
        contact: of the press, with its trace.
        path: file for the animation.

    Raises:
        WrongPress: the press has no trace, because nothing moves in it.
        MissingPackage: the viewer is not installed, or there is no display.
    """
    import mujoco

    from activetouch.pressing.rig import Rig

    if contact.trace is None:
        raise WrongPress("nothing moves in a quasistatic press; choose --fidelity dynamic or guarded_move")
    if path is None:
        viewer = _require_viewer()
    rig = Rig(scene.setup, placement.shape, timestep=float(contact.trace.time[0]), largest_scale=placement.scale)
    rig.place(float(contact.trace.position[0, 0]), placement)
    if path is not None:
        from activetouch.view.picture import write_motion

        middle, distance = np.array([0.01, 0.0, scene.setup.height]), 5.5 * max(scene.pad.half_width, 0.02)
        write_motion(path, rig.model, list(contact.trace.position[:, :1]), middle, distance)
        print(f"wrote {path}")
        return
    with viewer.launch_passive(rig.model, rig.data) as window:
        for position in itertools.cycle(contact.trace.position[:, 0]):
            if not window.is_running():
                break
            rig.data.qpos[0] = position
            mujoco.mj_forward(rig.model, rig.data)
            window.sync()
            time.sleep(rig.model.opt.timestep)


def _require_viewer() -> ModuleType:
    """MuJoCo's viewer; without a display it would end the process."""
    try:
        import glfw  # type: ignore[import-not-found]  # of an extra
        from mujoco import viewer
    except ImportError as error:
        raise MissingPackage(
            f"the viewer cannot be opened ({error}). Install it with: {install_command('viewer')}"
        ) from error
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # it also warns
        if not glfw.init():
            raise MissingPackage("there is no display for a window; activetouch touch draws into a file")
    return viewer


def record_cycles(scene: Scene, pressed: WorldObject, num_cycles: int, rng: np.random.Generator) -> list[Trace]:
    """Press an object repeatedly, with a rotation to a new random orientation after each press.

    Args:
        scene: its presses must simulate rotations, as guarded moves do.
        pressed: the object.
        num_cycles: number of presses.
        rng: of offsets, thresholds and rotations.

    Returns:
        One trace per cycle with all five phases; a miss has no phase ``contact``.

    Raises:
        WrongPress: the scene's presses do not simulate rotations.
        UnstablePress: the simulation diverged.
    """
    scene = replace(scene, press_model=scene.press_model.with_trace())
    placement = scene.place(pressed, 0, rng)
    cycles = []
    for _ in range(num_cycles):
        contact = scene.contact(placement, rng)
        orientation = random_orientation(rng)
        rotation = scene.press_model.rotate(scene.setup, placement, orientation)
        assert contact.trace is not None, "presses that rotate are traced"
        cycles.append(join([contact.trace, rotation]))
        offset = scene.variation.sample_offset(rng) + scene.aim_offsets[0]
        placement = replace(placement, orientation=orientation, offset=offset)
    return cycles
