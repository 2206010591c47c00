"""The files of a sensor: a reader, observation models with the scene that they were fitted to, and policies."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from activetouch.errors import LabelMismatch, NoIndependentModel, WrongScene
from activetouch.perception.card import read_card
from activetouch.perception.imaging import Imaging, differs_from_training, fields_read
from activetouch.scene import Scene, require_no_hand
from activetouch.scene_description import OBJECTS, require_scene, scene_fields
from belief.errors import CorruptFile, InvalidArgument
from belief.files import require_regular_file
from belief.observation_model.model import ArrayModel
from belief.observation_model.registry import read_observation_model, read_origin

MODELS = Path(__file__).parent / "models"
ANY_OBJECT_FILE = "any_object.safetensors"  # a reader that knows the sensor, for objects that the other does not know
PAD_FILE = "pad.toml"  # description of the pad that a reader of any object was trained for
READER_FILE, OBSERVATION_FILE = "reader.safetensors", "observation_model.json"
INDEPENDENT_FILE = "independent_model.json"  # beside a joint model: takes touches as independent given the shape
INDEPENDENT_SUFFIX = "-independent"  # suffix of the shipped sensor that reads shapes only
RECORDED_FILE = "recorded_reader.safetensors"  # a reader of recorded touches, in place of the reader
NOT_SIMULATED = (
    "no scene simulates recorded touches; find objects with TactileSensor.load(FOLDER).session(TARGET), and compare "
    "deciders on the recordings with activetouch recorded"
)
POLICIES = "policies"  # folder of trained policies beside the two


def observation_file(folder: Path, independent: bool = False) -> Path:
    """The file of a sensor's observation model; ``independent`` prefers the model that takes touches as independent."""
    other = folder / INDEPENDENT_FILE
    return other if independent and other.exists() else folder / OBSERVATION_FILE


class FittedModel(NamedTuple):
    """An observation model with the fields of its scene and of its recorded touches; each None if it has none."""

    model: ArrayModel
    scene: Mapping[str, Any] | None
    recorded: Mapping[str, Any] | None = None


def fitted_model(folder: Path, independent: bool = False) -> FittedModel:
    """The observation model in a folder, see :func:`observation_file`, and what it was fitted to."""
    path = observation_file(folder, independent)
    try:
        text = require_regular_file(path).read_text(encoding="utf-8")
        scene, recorded = ((read_origin(text) or {}).get(name) for name in ("scene", "recorded"))
        for name, fields in (("scene", scene), ("recorded", recorded)):
            if not (fields is None or isinstance(fields, dict)):
                raise ValueError(f"its {name} is {fields!r}")
        model = read_observation_model(text)
    except OSError as error:
        raise CorruptFile(f"{path} cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise CorruptFile(f"{path} is no observation model: {error}") from error
    if independent and model.reads == "embeddings":
        raise NoIndependentModel(
            f"{folder} holds only the joint observation model {model.name!r}, and no {INDEPENDENT_FILE} beside it. "
            "The command calibrate writes both files"
        )
    return FittedModel(model, scene, recorded)


def files_for(
    folder: Path, scene: Scene, anyway: bool = False, independent: bool = False, unknown_state: bool = False
) -> tuple[Path, FittedModel | None, tuple[str, ...]]:
    """The file of the reader, the observation model, and differences of the scene, in words; the network is not loaded.

    The model is None where it is to be made for the scene. The differences from the sensor's own scene are known
    shifts; with ``anyway``, all others too, as long as the network can read the images at all.
    """
    if len(scene.shapes) < 2:
        raise InvalidArgument("one shape: nothing to tell apart; add a mesh or leave out --only")
    path = reader_file(folder, scene, independent, unknown_state)
    if scene.hand is not None and independent:
        raise NoIndependentModel("the fingers of a hand touch one body; the independent model reads single touches")
    is_made_here = path.name == ANY_OBJECT_FILE or scene.hand is not None
    fitted = None if is_made_here else fitted_model(folder, independent)
    card, here = read_card(path), scene_fields(scene)
    card.require_labels(scene.shape_labels, scene.pose_labels)
    if not card.knows_orientations:
        require_no_hand(scene.hand, f"the reader in {folder}")
    made_for = [("the reader", card.in_poses_of(here))]
    made_for += [] if fitted is None else [("the observation model", fitted.scene)]
    if card.imaging is not None:
        imaging = Imaging.from_fields(card.imaging)
        made_for = [(what, own and fields_read(imaging, own, scene, here)) for what, own in made_for]
    elif fitted is not None:
        require_model(fitted.model, scene)
    found = [require_scene(f"{what} in {folder}", own, here, anyway) for what, own in made_for]
    card.require_images(scene.image_shape)
    return path, fitted, tuple(dict.fromkeys(sum(found, ())))


def reader_file(folder: Path, scene: Scene, independent: bool = False, unknown_state: bool = False) -> Path:
    """The file of the reader with which a sensor reads a scene.

    Beside the reader of its own objects, a sensor may have one of any object. It reads other shapes and poses, and the
    own ones where the scene says that the sensor has changed: other forces, stiffness, noise, broken taxels, an image
    that is shifted or blurred. Only it can infer an ``unknown_state`` of the sensor. It cannot take touches as
    ``independent`` given the shape: then the reader of the own objects reads them in any state of the sensor.
    """
    require_simulated(folder)
    own, other = shipped_file(folder / READER_FILE), folder / ANY_OBJECT_FILE
    if unknown_state:
        if scene.hand is not None:
            raise InvalidArgument("no state of the sensor is inferred with a hand; leave out --unknown-state or --hand")
        found = other if other.exists() else own
        if read_card(found).imaging is None:
            raise InvalidArgument(f"{folder} has no reader of any object, which alone knows states of the sensor")
        return _joint(found, independent)
    if not other.exists():
        return own
    if scene.hand is not None and scene.hand.offset != "averaged":
        return _joint(other, independent)
    model = observation_file(folder, independent)
    if not (own.exists() or model.exists()):
        return _joint(other, independent)
    for path in (own, model):
        if not path.exists():
            raise CorruptFile(f"{path} is missing; without it, the other files in {folder} are no sensor")
    fitted_to, here = fitted_model(folder, independent).scene, scene_fields(scene)
    own_objects = [part for part in OBJECTS if part not in ("presentation", "hand")]
    if fitted_to is None or any(fitted_to.get(part) != here.get(part) for part in own_objects):
        return _joint(other, independent)
    return other if not independent and differs_from_training(read_card(other).imaging, scene) else own


def scene_of(name: str) -> str:
    """Name of the scene of a shipped sensor, such as gel of ``gel-convnext``."""
    return name.partition("-")[0]


def shipped_file(path: Path) -> Path:
    """The file itself, or its copy in the cache if it is a shipped one that this installation lacks."""
    if path.exists():
        return path
    from activetouch.fetched_models import model_file  # what has all files does not need it

    return model_file(path)


def doubting_file(folder: Path, scene: Scene, independent: bool = False) -> Path:
    """The reader of any object with which a sensor may doubt its description."""
    found = any_object_file(folder, scene, independent)
    if found is None:
        raise InvalidArgument(
            "a sensor doubts its description where touches are odd if it has a joint model and a reader of any object, "
            f"and no hand; {folder} does not: leave out the doubt (unknown_state, --doubted-state)"
        )
    return found


def other_reader(folder: Path, own: Path, scene: Scene, independent: bool = False) -> Path | None:
    """The reader of any object beside the own one, where a joint model of single touches may ask it; None without."""
    found = any_object_file(folder, scene, independent)
    return None if found == own else found


def any_object_file(folder: Path, scene: Scene, independent: bool = False) -> Path | None:
    """The reader of any object of a sensor, where a joint model of single touches may ask it; None without."""
    other = folder / ANY_OBJECT_FILE
    return None if not other.exists() or independent or scene.hand is not None else other


def require_simulated(folder: Path) -> None:
    """Raise WrongScene where a folder holds a sensor of recorded touches, which work in no scene."""
    if (folder / RECORDED_FILE).exists():
        raise WrongScene(f"{folder} holds a sensor of recorded touches: {NOT_SIMULATED}")


def _joint(path: Path, independent: bool) -> Path:
    if independent:
        raise NoIndependentModel(f"{path} reads these objects, and takes all touches of one as of one body")
    return path


def is_of_objects(model_scene: Mapping[str, Any] | None, scene: Scene) -> bool:
    """Whether an observation model was fitted to the objects and poses of a scene."""
    here, own = scene_fields(scene), model_scene or {}
    sizes = [fields.get("variation", {}).get("size") for fields in (own, here)]
    return all(own.get(name) == here.get(name) for name in OBJECTS) and sizes[0] == sizes[1]


def is_farther_off(model_scene: Mapping[str, Any] | None, scene: Scene) -> bool:
    """Whether objects are pressed farther beside the middle than those that an observation model was fitted to."""
    own = (model_scene or {}).get("variation", {}).get("offset", {})
    ends = [abs(end) for end in own.values() if isinstance(end, float)]
    return bool(ends) and max(np.abs(scene.variation.offset.support)) > max(ends) * (1 + 1e-9)


def require_model(model: ArrayModel, scene: Scene) -> None:
    """Check that an observation model is about the shapes and poses of a scene."""
    shapes, poses = scene.shape_labels, scene.pose_labels
    if model.shape_labels != shapes or model.num_poses != len(poses):
        raise LabelMismatch(
            f"the observation model is about the shapes {list(model.shape_labels)} in {model.num_poses} poses, the "
            f"scene has {list(shapes)} in {len(poses)}; this scene needs an observation model of its own"
        )
