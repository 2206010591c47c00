"""The commands ``touch``, ``gallery``, ``record`` and ``view``, which show single presses."""

from __future__ import annotations

import itertools
import time
import warnings
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Annotated

import numpy as np
import tyro
from rich.progress import track

from activetouch.errors import WrongPress
from activetouch.placement import Placement
from activetouch.pressing.trace import write_csv
from activetouch.rendering import RENDERERS
from activetouch.scene import Scene
from belief.claims import claim_folder, ends_claims
from belief.errors import MissingPackage
from belief.files import in_file_name, require_writable_file
from belief.seeding import keyed_rng
from experiments.command_line.arguments import Count, Picture, Seed, check_arguments
from experiments.press.cycles import record_cycles
from experiments.scene_choice import SceneChoice

if TYPE_CHECKING:
    from activetouch.pressing.contact import Contact


def traced(scene: Scene) -> Scene:
    """The scene with a trace of its presses, if they can record one."""
    return replace(scene, press_model=scene.press_model.with_trace())


@dataclass(frozen=True)
class TouchCommand:
    """Draw one press: the scene, the height map, the images of three renderers, and the force over time.

    For example:

        activetouch touch --shape cone --pose corner --out cone.png
        activetouch touch --scene paper --seed 3
    """

    choice: Annotated[SceneChoice, tyro.conf.arg(name="")] = field(default_factory=SceneChoice)
    """The world."""
    shape: str | None = None
    """Label of the shape to press; the scene's first by default."""
    pose: str | None = None
    """Label of the pose; the scene's first by default."""
    seed: Seed = 0
    """Seed of the object's size and orientation and of the press."""
    out: Picture = Path("runs/touch.png")
    """File for the picture; the ending decides the format."""

    def run(self) -> None:
        """Press once and draw."""
        check_arguments(self)
        from activetouch.view.picture import GL_HINT, press_picture
        from experiments.press.figures import draw_touch

        require_writable_file(self.out)
        scene = traced(self.choice.named.scene)
        shape, pose = self.shape or scene.shape_labels[0], self.pose or scene.pose_labels[0]
        placement, contact = press_new_object(scene, shape, pose, self.seed)
        view, by_opengl = press_picture(scene.setup, placement, contact.depth)
        if not by_opengl:
            print(GL_HINT)
        title = f"a {shape} in pose {pose}: {contact.force:.2f} N, {1e3 * contact.depth:.2f} mm deep" + (
            " (bottomed out)" if contact.is_bottomed_out else ""
        )
        draw_touch(title, view, contact, self.out)
        print(f"wrote {self.out}")


def press_new_object(scene: Scene, shape: str, pose: str, seed: int) -> tuple[Placement, Contact]:
    """Placement and contact of one press of a new random object.

    Raises:
        UnknownName: the scene has no such shape or pose.
    """
    rng = np.random.default_rng(seed)
    pressed = scene.press(scene.sample_object(shape, rng), pose, rng)
    return pressed.placement, pressed.contact


@dataclass(frozen=True)
class Gallery:
    """Draw the images of every shape in every pose by every renderer.

    For example:

        activetouch gallery --out docs/gallery.png
    """

    choice: Annotated[SceneChoice, tyro.conf.arg(name="")] = field(default_factory=SceneChoice)
    """The world."""
    seed: Seed = 4
    """Seed of the objects' sizes and orientations."""
    out: Picture = Path("docs/gallery.png")
    """File for the picture; the ending decides the format."""

    def run(self) -> None:
        """Press every shape in every pose and draw."""
        check_arguments(self)
        from experiments.press.figures import draw_gallery

        require_writable_file(self.out)
        scene = traced(self.choice.named.scene)
        images = {}
        for shape_index, shape in enumerate(track(scene.shape_labels, "pressing")):
            thing = scene.sample_object(shape_index, keyed_rng([self.seed, shape_index], is_fixed_length=True))
            for pose_index, pose in enumerate(scene.pose_labels):
                contact, *_ = scene.press(
                    thing, pose_index, keyed_rng([self.seed, shape_index, pose_index], is_fixed_length=True)
                )
                for name, renderer in RENDERERS.items():
                    images[shape, name, pose] = renderer(contact)
        draw_gallery(images, scene.pose_labels, self.out)
        print(f"wrote {self.out}")


@dataclass(frozen=True)
class Record:
    """Press an object of each shape repeatedly and write every step, one CSV file per object (paper §5.4).

    The columns are cycle, time [s], position x, y, z [m], force fx, fy, fz [N] and phase (approach, contact, pause,
    withdraw, rotate). Rotations need guarded moves, as in the default scene "paper".

    For example:

        activetouch record --cycles 20 --out runs/log
    """

    choice: Annotated[SceneChoice, tyro.conf.arg(name="")] = field(default_factory=lambda: SceneChoice(scene="paper"))
    """The world."""
    cycles: Count = 10
    """Number of presses of each object."""
    seed: Seed = 0
    """Seed of the objects and their presses."""
    out: Path = Path("runs/log")
    """Folder for the files."""

    @ends_claims
    def run(self) -> None:
        """Press and write."""
        check_arguments(self)
        claim_folder(self.out)
        scene = self.choice.named.scene
        for shape_index, shape in enumerate(track(scene.shape_labels, "pressing")):
            rng = keyed_rng([self.seed, shape_index], is_fixed_length=True)
            cycles = record_cycles(scene, scene.sample_object(shape_index, rng), self.cycles, rng)
            write_csv(self.out / f"{in_file_name(shape, '-')}.csv", cycles)
        print(f"wrote {len(scene.shapes)} files to {self.out}")


def _require_viewer() -> ModuleType:
    """MuJoCo's viewer.

    Raises:
        MissingPackage: it is not installed, or there is no display, which would end the process.
    """
    try:
        import glfw  # type: ignore[import-not-found]  # of an extra
        from mujoco import viewer
    except ImportError as error:
        raise MissingPackage(
            f"the viewer cannot be opened ({error}). Install it with: pip install 'activetouch[viewer]'"
        ) from error
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # it also warns
        if not glfw.init():
            raise MissingPackage("there is no display for a window; activetouch touch draws into a file")
    return viewer


@dataclass(frozen=True)
class View:
    """Show a press in MuJoCo's window; this needs the extra "viewer" and a display.

    For example:

        activetouch view --scene paper --shape cone
    """

    choice: Annotated[SceneChoice, tyro.conf.arg(name="")] = field(default_factory=SceneChoice)
    """The world."""
    shape: str | None = None
    """Label of the shape to press; the scene's first by default."""
    pose: str | None = None
    """Label of the pose; the scene's first by default."""
    seed: Seed = 0
    """Seed of the object's size and orientation and of the press."""

    def run(self) -> None:
        """Show the press until the window is closed."""
        check_arguments(self)
        import mujoco

        from activetouch.pressing.rig import Rig

        scene = traced(self.choice.named.scene)
        shape, pose = self.shape or scene.shape_labels[0], self.pose or scene.pose_labels[0]
        placement, contact = press_new_object(scene, shape, pose, self.seed)
        if contact.trace is None:
            raise WrongPress("nothing moves in a quasistatic press; choose --fidelity dynamic or guarded_move")
        viewer = _require_viewer()
        rig = Rig(scene.setup, placement.shape, timestep=float(contact.trace.time[0]))
        rig.place(float(contact.trace.position[0, 0]), placement)
        with viewer.launch_passive(rig.model, rig.data) as window:
            for position in itertools.cycle(contact.trace.position[:, 0]):
                if not window.is_running():
                    break
                rig.data.qpos[0] = position
                mujoco.mj_forward(rig.model, rig.data)
                window.sync()
                time.sleep(rig.model.opt.timestep)
