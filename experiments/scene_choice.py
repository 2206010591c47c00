"""Scenes and renderers by name, as on the command line.

A name is a key of a registry, a name that an installed package registers (entry points ``activetouch.scenes`` and
``activetouch.renderers``), or ``module:attribute``.
"""

from __future__ import annotations

import dataclasses
import hashlib
import re
import shlex
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias, get_args

import numpy as np
import tyro

from activetouch import Dynamic, Quasistatic, Scene
from activetouch.distributions import Constant, Uniform
from activetouch.errors import DuplicateShape
from activetouch.named_scenes import SCENES, NamedScene, as_named
from activetouch.orientations import Held, Inexact, Moves, Presentation, Resampled, Tumbled, Upright
from activetouch.pressing.contact import Press
from activetouch.pressing.dynamic import GuardedMove
from activetouch.rendering import RENDERERS, TactileRenderer
from activetouch.rendering.renderer import require_renderer
from belief.codec import OPTIONAL, from_fields, to_fields
from belief.constraints import Within
from belief.errors import InvalidArgument
from belief.naming import index_of
from belief.references import BadReference, build, find
from experiments.command_line.arguments import Trust, one_of

if TYPE_CHECKING:
    from activetouch.solids.mesh import Mesh

FIDELITIES: Mapping[str, Press] = {
    "quasistatic": Quasistatic(),
    "dynamic": Dynamic(),
    "guarded_move": GuardedMove(),
}
PRESENTATIONS: Mapping[str, Presentation] = {
    "tumbled": Tumbled(),
    "inexact": Inexact(),
    "upright": Upright(),
    "resampled": Resampled(),
    "held": Held(),
}


HandName: TypeAlias = Literal["one_finger", "parallel", "three_finger", "allegro"]
FidelityName: TypeAlias = Literal[tuple(FIDELITIES)]  # type: ignore[valid-type]
PresentationName: TypeAlias = Literal[tuple(PRESENTATIONS)]  # type: ignore[valid-type]
_DEGREES, _MILLIMETRES = Within(0.0, 90.0), Within(0.0, 100.0)
_LONGEST_NAME = 150  # of a folder [bytes]; longer ones end in a digest
_FACTORS = re.compile(r"(?:^|,)(\w+)=([^,=]+?)\.\.([^,=]+)")


def named_scene(name: str) -> NamedScene:
    """The scene with this name, and its search; ``module:attribute`` is a scene or a function that returns one."""
    found, reference = find("scene", name, SCENES, "activetouch.scenes")
    made = build(reference.name, found, reference.settings, {}, reference.is_called)
    if not isinstance(made, Scene | NamedScene):
        raise BadReference(f"{name} is not a scene: it is {made!r:.80}, not an activetouch.Scene or NamedScene")
    return made if isinstance(made, NamedScene) else as_named(made)


def renderer_named(name: str) -> TactileRenderer:
    """The renderer with this name; ``module:attribute`` is a renderer, or a class or function that makes one."""
    found, reference = find("renderer", name, RENDERERS, "activetouch.renderers")
    is_plain = callable(found) and hasattr(found, "isotropic") and not isinstance(found, type)
    is_ready = is_plain and not reference.is_called
    made = found if is_ready else build(reference.name, found, reference.settings, {}, reference.is_called)
    require_renderer(made)
    return made


def in_file_names(scene: str) -> str:
    """The name of a scene as used in folder names.

    >>> in_file_names("gel"), in_file_names("mine:scene(force=2)")
    ('gel', 'mine-scene-force-2')
    """
    return re.sub(r"[^\w.]+", "-", scene).strip("-.")


def command(name: str, *words: object, **options: object) -> str:
    """A command line, such as ``command("train", scene="gel")``; options that are None are omitted."""
    told = [str(word) for word in words]
    for option, value in options.items():
        if value is not None:
            told += [f"--{option.replace('_', '-')}", str(value)]
    return shlex.join(["activetouch", name, *told])


def choice_name(choice: SceneChoice) -> str:
    """The name of a scene with its changes, as used in folder names."""
    own = [choice.fidelity, choice.renderer, choice.presentation, choice.poses, "only" if choice.only else None]
    own.append(choice.pad.stem if choice.pad else None)
    meshes: Iterable[str] = ()
    if choice.meshes:
        from activetouch.mesh_source import labelled_sources

        meshes = labelled_sources(*choice.meshes)[0]
    turns = (f"moves-{choice.moves:g}-{choice.moves_turn:g}-{choice.moves_shift:g}",) if choice.moves else ()
    missed = [f"{what}-{by:g}" for what, by in (("error", choice.pose_error), ("off", choice.off)) if by is not None]
    changes = [*own, *meshes, *choice.family, choice.hand, *turns, *missed]
    name = in_file_names("-".join([choice.scene, *(str(change) for change in changes if change)]))
    if len(name.encode()) <= _LONGEST_NAME:
        return name
    start = name.encode()[: _LONGEST_NAME - 9].decode(errors="ignore")
    return f"{start}-{hashlib.sha256(name.encode()).hexdigest()[:8]}"


def collection_folder(scene: str) -> Path:
    """Default folder of a scene's collection of touches."""
    return Path("data") / in_file_names(scene)


def repeats_folder(scene: str) -> Path:
    """Default folder of a scene's repeated touches, which observation models are fitted to."""
    return Path("data") / f"{in_file_names(scene)}-repeats"


def training_folder(scene: str) -> Path:
    """Default folder of a scene's classifier training."""
    return Path(f"runs/train-{in_file_names(scene)}")


def with_families(shapes: Mapping[str, Any], families: Sequence[str]) -> tuple[dict[str, Any], Uniform | None]:
    """Shapes, of which some become families, and the range of the sizes of all objects; None if they stay as they are.

    Each of ``families`` is ``SHAPE:PARAMETER=LOW..HIGH``, with several parameters separated by commas, or
    ``size=LOW..HIGH`` for all objects. The factors on the nominal number are uniform. A shape that is a family already
    gets a new one of its nominal solid.

    >>> from activetouch.shapes import Cylinder
    >>> with_families({"rod": Cylinder(0.016, 0.020)}, ["rod:half_length=0.5..2"])[0]["rod"]
    Family(Cylinder(radius=0.016, half_length=0.02), half_length=Uniform(low=0.01, high=0.04))
    """
    from activetouch.solids.family import Family, numbers_of

    found, size, labels = dict(shapes), None, list(shapes)
    for text in families:
        label, _, told = text.rpartition(":")
        try:
            ranges = [(name, float(low), float(high)) for name, low, high in _FACTORS.findall(told)]
            if not label and [name for name, *_ in ranges] == ["size"]:
                size = Uniform(*ranges[0][1:])
                continue
            is_again = label in shapes and found[label] is not shapes[label]
            if len(ranges) != told.count(",") + 1 or len({name for name, *_ in ranges}) < len(ranges) or is_again:
                raise ValueError("each shape and each parameter is told once, with LOW..HIGH")
            shape = shapes[labels[index_of("shape", labels, label)]]
            solid = shape.nominal if isinstance(shape, Family) else shape
            numbers = numbers_of(solid)  # a name that is not among them is refused by the family
            scales = {name: Uniform(*(numbers.get(name, 1.0) * end for end in ends)) for name, *ends in ranges}
            found[label] = Family(solid, **scales)
        except ValueError as error:
            raise InvalidArgument(
                "--family must be SHAPE:PARAMETER=LOW..HIGH, such as cylinder:half_length=0.5..2, or size=LOW..HIGH, "
                f"got {text!r}: {error}"
            ) from error
    return found, size


@dataclass(frozen=True)
class SceneChoice:
    """A scene, and what differs from it; by default nothing."""

    scene: str = "gel"
    """paper, coarse, gel, hard, many or keyed; or module:attribute of your own."""
    fidelity: Annotated[FidelityName | None, one_of(FIDELITIES)] = None
    """Press model."""
    renderer: str | None = None
    """force_patch, pressure or gelsight, or module:attribute of your own."""
    presentation: Annotated[PresentationName | None, one_of(PRESENTATIONS)] = None
    """Distribution of object orientations."""
    poses: str | None = None
    """Set of poses: mix (six) or directions26."""
    meshes: tuple[Path, ...] = ()
    """Mesh files of shapes to add, or folders, each [NAME=]PATH[@SCALE], such as mug.obj@0.001 for millimetres."""
    only: bool = False
    """Leave out the scene's own shapes; the sizes of the meshes do not vary."""
    family: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    """Factors on the sizes of all objects, size=0.9..1.1, or on a shape's proportions, cylinder:half_length=0.5..2."""
    hand: Annotated[HandName | None, one_of(get_args(HandName))] = None
    """Hand whose pads close on the object, quasistatically: a grasp counts as one touch."""
    moves: Annotated[float, Within(0.0, 1.0), OPTIONAL] = 0.0
    """Probability that an object turns and shifts between two touches, such as 0.2."""
    moves_turn: Annotated[float, _DEGREES, OPTIONAL] = 15.0
    """How it turns when it moves: one standard deviation about each axis [degrees]."""
    moves_shift: Annotated[float, _MILLIMETRES, OPTIONAL] = 5.0
    """How far its centre then is from its place at most, along each axis [mm]."""
    pose_error: Annotated[float | None, _DEGREES, OPTIONAL] = None
    """Deviation about each axis by which every touch misses its pose [degrees]."""
    off: Annotated[float | None, _MILLIMETRES, OPTIONAL] = None
    """Largest distance of an object's centre from the approach axis, along each axis, in every touch [mm]."""
    pad: Annotated[Path | None, OPTIONAL] = None
    """TOML description of your own pad, which touches the scene's objects, quasistatically; docs/your_own_pad.md."""
    full: bool = False
    """Also simulate what changes no touch: a finger behind the pad, and the other objects, parked on their guides."""
    robot: Literal["panda_allegro"] | None = None
    """Robot that stands behind the pad and changes no touch; needs --menagerie."""
    menagerie: Path | None = None
    """A copy of MuJoCo Menagerie, with the model of the robot, or, in touch --hand allegro, of the hand that closes."""

    @property
    def is_tray(self) -> bool:
        """Whether objects lie in a tray: ``drawer``, with or without settings, which is no scene of one object."""
        return self.scene.partition("(")[0] == "drawer"

    @property
    def left_out(self) -> list[str]:
        """Lines on the files in folders of meshes that are left out, which say why."""
        return self.meshes_read[1]

    @cached_property
    def meshes_read(self) -> tuple[dict[str, Mesh], list[str]]:
        """The meshes by label, and a line on each file that is left out."""
        if not self.meshes:
            return {}, []
        from activetouch.mesh_source import read_files

        return read_files(*self.meshes)

    @cached_property
    def named(self) -> NamedScene:
        """The scene with its changes, and its search."""
        named = named_scene(self.scene)
        changes: dict[str, Any] = {}
        if self.fidelity is not None:
            changes["press_model"] = FIDELITIES[self.fidelity]
        if self.renderer is not None:
            changes["renderer"] = renderer_named(self.renderer)
        if self.presentation is not None:
            changes["presentation"] = PRESENTATIONS[self.presentation]
        if self.poses is not None:
            changes |= {"poses": self.poses, "aims": {}}
        if self.only and not self.meshes:
            raise InvalidArgument("--only leaves out the scene's own shapes; give others with --meshes")
        own = {} if self.only else named.scene.shapes
        if self.meshes:
            from activetouch.mesh_source import warn_of_files

            added = self.meshes_read[0]
            warn_of_files(self.left_out)
            if taken := [label for label in added if label in own]:
                raise DuplicateShape(
                    f"the scene {self.scene!r} has the shapes {', '.join(own)}; the meshes to add must have other "
                    f"names, got {', '.join(taken)}: write for example my_{taken[0]}={taken[0]}.obj, or leave the "
                    "scene's own shapes out with --only"
                )
            changes["shapes"] = {**own, **added}
        sizes = None
        if self.family:
            changes["shapes"], sizes = with_families(changes.get("shapes", named.scene.shapes), self.family)
        if sizes is not None or self.only:
            changes["variation"] = replace(named.scene.variation, size=Constant(1.0) if sizes is None else sizes)
        if self.hand is not None:
            if self.fidelity == "guarded_move":
                raise InvalidArgument("--hand closes by --fidelity quasistatic, the default, or dynamic")
            changes |= {"hand": self.hand, "press_model": Quasistatic()}
            if self.fidelity == "dynamic":
                from activetouch.pressing.closing import Closing  # loads MuJoCo

                changes["press_model"] = Closing()
        if self.pose_error is not None:
            if self.presentation not in (None, "tumbled", "inexact"):
                raise InvalidArgument(f"--pose-error is of tumbled objects, not of --presentation {self.presentation}")
            changes["presentation"] = Inexact(float(np.deg2rad(self.pose_error)))
        if self.off is not None:
            variation = changes.get("variation", named.scene.variation)
            changes["variation"] = replace(variation, offset=Uniform(-1e-3 * self.off, 1e-3 * self.off))
        if self.moves:
            changes["moves"] = Moves(self.moves, float(np.deg2rad(self.moves_turn)), 1e-3 * self.moves_shift)
        scene = replace(named.scene, **changes)
        if (self.robot is None) is not (self.menagerie is None):
            raise InvalidArgument("--robot panda_allegro and --menagerie FOLDER, which has its models, go together")
        if self.full or self.robot is not None:
            scene = scene.with_surroundings(self.full, self.menagerie)
        if self.pad is not None:
            from activetouch.pad_file import read_pad  # other scenes do not need it

            if self.hand or self.fidelity not in (None, "quasistatic") or self.renderer or self.full or self.robot:
                raise InvalidArgument(
                    "--pad is pressed quasistatically and shows its taxels; leave out --hand, --fidelity, --renderer, "
                    "--full and --robot"
                )
            scene = read_pad(self.pad).scene(scene)
        num_objects = min(named.num_objects, len(scene.shapes)) if self.only else named.num_objects
        return replace(named, scene=scene, num_objects=num_objects)

    def __getstate__(self) -> dict[str, Any]:
        """State for pickling: the names only; the receiving process resolves them."""
        return {name: value for name, value in vars(self).items() if name not in ("named", "meshes_read")}

    def to_dict(self) -> dict[str, Any]:
        """The choice as plain values."""
        return to_fields(self)

    @classmethod
    def from_dict(cls, fields: Mapping[str, Any], trust: Trust) -> SceneChoice:
        """The choice from :meth:`to_dict`, in a file."""
        trust.require([fields["scene"], fields.get("renderer")])
        names = {field.name for field in dataclasses.fields(cls)}
        without_effect = (None, False, 1.0)  # options of earlier versions
        known = {name: value for name, value in fields.items() if name in names or value not in without_effect}
        return from_fields(cls, known)
