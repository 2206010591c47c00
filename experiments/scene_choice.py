"""From the names on a command line to a scene: here, and nowhere deeper, strings become objects."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

from activetouch import Dynamic, Quasistatic
from activetouch.named_scenes import SCENES, NamedScene
from activetouch.orientations import Presentation, Resampled, Tumbled, Upright
from activetouch.pressing.deformable import Deformable
from activetouch.pressing.guarded_move import GuardedMove
from activetouch.pressing.press import Press
from activetouch.rendering import RENDERERS
from activetouch.shapes import Mesh
from belief.errors import ActiveTouchError, UnknownName
from experiments.command_line.arguments import Positive

FIDELITIES: Mapping[str, Press] = {
    "quasistatic": Quasistatic(),
    "dynamic": Dynamic(),
    "guarded_move": GuardedMove(),
    "deformable": Deformable(),
}
PRESENTATIONS: Mapping[str, Presentation] = {"tumbled": Tumbled(), "upright": Upright(), "resampled": Resampled()}


def named_scene(name: str) -> NamedScene:
    """The scene of that name.

    Raises:
        UnknownName: there is none.
    """
    if name not in SCENES:
        raise UnknownName("scene", name, list(SCENES))
    return SCENES[name]


def collection_folder(scene: str) -> Path:
    """Where touches of a scene are collected unless told otherwise."""
    return Path("data") / scene


def repeats_folder(scene: str) -> Path:
    """Where objects of a scene are touched again and again, to calibrate on, unless told otherwise."""
    return Path("data") / f"{scene}-repeats"


def bank_folder(scene: str) -> Path:
    """Where the touch banks of a scene are unless told otherwise."""
    return Path("data") / f"{scene}-bank"


def training_folder(scene: str) -> Path:
    """Where the classifier of a scene is trained unless told otherwise."""
    return Path(f"runs/train-{scene}")


class DuplicateShape(ActiveTouchError, ValueError):
    """Two shapes of a scene would have the same name."""


@dataclass(frozen=True)
class SceneChoice:
    """A named scene, and what to change about it."""

    scene: str = "gel"
    """Which world: paper, coarse, gel, hard or many."""
    fidelity: Literal["quasistatic", "dynamic", "guarded_move", "deformable"] | None = None
    """How presses are made; the scene's own way by default."""
    renderer: Literal["force_patch", "pressure", "gelsight"] | None = None
    """What the images show; the scene's own by default."""
    presentation: Literal["tumbled", "upright", "resampled"] | None = None
    """How objects lie; the scene's own by default."""
    meshes: tuple[Path, ...] = ()
    """Mesh files (STL, OBJ, PLY, OFF) of shapes to add; a shape is called what its file is."""
    mesh_scale: Positive = 1.0
    """Metres per unit of those files: 0.001 for millimetres."""
    robot: Literal["panda_allegro"] | None = None
    """A robot to stand behind the pad; its models are read from $MENAGERIE_ROOT."""

    @cached_property
    def named(self) -> NamedScene:
        """The scene, changed as asked, and its search.

        Raises:
            UnknownName: there is no such scene.
            DuplicateShape: a mesh is called like a shape of the scene.
            BadMesh: a mesh file holds no solid.
        """
        named = named_scene(self.scene)
        changes: dict[str, Any] = {}
        if self.fidelity is not None:
            changes["press_model"] = FIDELITIES[self.fidelity]
        if self.renderer is not None:
            changes["renderer"] = RENDERERS[self.renderer]
        if self.presentation is not None:
            changes["presentation"] = PRESENTATIONS[self.presentation]
        if self.robot is not None:
            changes["robot"] = self.robot
        if self.meshes:
            added = {path.stem: Mesh.from_file(path, self.mesh_scale) for path in self.meshes}
            if len(added) < len(self.meshes) or added.keys() & named.scene.shapes.keys():
                raise DuplicateShape(
                    f"the scene {self.scene!r} has the shapes {', '.join(named.scene.shapes)}; the meshes to add must "
                    f"have other names and differ from each other, got {', '.join(p.stem for p in self.meshes)}"
                )
            changes["shapes"] = {**named.scene.shapes, **added}
        return replace(named, scene=replace(named.scene, **changes))

    def to_dict(self) -> dict[str, Any]:
        """The choice as plain values."""
        return {**asdict(self), "meshes": [str(path) for path in self.meshes]}

    @classmethod
    def from_dict(cls, fields: Mapping[str, Any]) -> SceneChoice:
        """The choice from :meth:`to_dict`."""
        return cls(**{**fields, "meshes": tuple(Path(path) for path in fields["meshes"])})
