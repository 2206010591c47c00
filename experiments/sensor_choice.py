"""Sensors and collections on the command line: checks that they fit a scene, and remedies where they do not."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from activetouch.errors import LabelMismatch, SceneShift, WrongScene
from activetouch.named_scenes import SCENES, NamedScene
from activetouch.perception.reader import HypothesisTable, TactileReader
from activetouch.rendering import PressureRenderer
from activetouch.scene import Scene
from activetouch.scene_description import in_words, require_scene, scene_fields
from activetouch.sensor import TactileSensor
from activetouch.sensor_files import (
    ANY_OBJECT_FILE,
    INDEPENDENT_SUFFIX,
    MODELS,
    PAD_FILE,
    POLICIES,
    READER_FILE,
    files_for,
    observation_file,
    require_simulated,
    shipped_file,
)
from activetouch.solids.solid import Shape
from belief.errors import ActiveTouchError, InvalidArgument
from experiments.parallel import Shared, run_tasks
from experiments.scene_choice import SceneChoice, choice_name, command, in_file_names, named_scene
from planners.registry import trained_state

if TYPE_CHECKING:
    from activetouch.data.manifest import Manifest
    from activetouch.perception.card import ClassifierCard
    from activetouch.perception.contacts.views import ViewPlan
    from activetouch.perception.many_bodies import NestedPlan

_VIEWS, _VIEW = 1056, 0.0004  # of a body of few triangles, and the seconds of one
_TRIANGLE = 1.7e-5  # seconds of all views of a body, for each of its triangles
REPEATS = ("--plan.train", "0", "--plan.repeats", "6")
"""Options of ``collect`` for the touches that a sensor is calibrated with."""


class NoSensor(ActiveTouchError, FileNotFoundError):
    """A folder holds no sensor."""


def require_policies(decider: str, targets: Sequence[str], scene: str, sensor: Path) -> None:
    """Check that a decider has all trained policies that it needs."""
    if (state := trained_state(decider)) is None:
        return
    from planners.ppo import BadPolicy, MissingPolicy, load_ppo_policy, policy_file

    try:
        for target in targets:
            load_ppo_policy(sensor / POLICIES, state, target)
    except (MissingPolicy, BadPolicy) as error:
        ready = independent_sensor(scene)
        if ready != sensor and (ready / POLICIES / policy_file(state, targets[0])).is_file():
            raise type(error)(f"{error}. The sensor {ready.name} has policies: add --sensor {ready.name}") from error
        train = command("train-ppo", scene=scene, sensor=sensor, recipes=state)
        raise type(error)(
            f"{error}. Train policies, and copy their folder {POLICIES} into that of the sensor:\n{train}"
        ) from error


def independent_sensor(scene: str) -> Path:
    """Folder of the shipped sensor of a scene that reads shapes only; where there is none, of its usual sensor."""
    usual = sensor_folder(None, scene)
    own = usual.with_name(f"{usual.name}{INDEPENDENT_SUFFIX}")
    return own if own.is_dir() else usual


def described_sensor(given: Path | None) -> Path | None:
    """Folder of the shipped reader of any pad, for the pad that a file describes; None where it is no such file."""
    if given is None or given.suffix != ".toml" or given.is_dir():
        return None
    from activetouch.sensor.any_pad import sensor_of_pad  # other sensors do not need it

    return sensor_of_pad(given)


def sensor_folder(given: Path | None, scene: str, pad: Path | None = None) -> Path:
    """Folder of a sensor: ``given`` is a folder, a scene with a shipped sensor, or a file that describes a pad.

    None means that of ``scene``, or of the file ``pad``: then the shipped reader of any pad.
    """
    if (own := described_sensor(pad if given is None else given)) is not None:
        return own
    if given is None:
        return MODELS / in_file_names(scene)
    shipped = MODELS / given
    return shipped if len(given.parts) == 1 and not given.exists() and shipped.is_dir() else given


def open_sensor(
    folder: Path | None,
    choice: SceneChoice | NamedScene,
    anyway: bool = False,
    independent: bool = False,
    unknown_state: bool | None = False,
    jobs: int | None = None,
    nested: bool | None = None,
    other_proportions: bool = False,
    doubting: bool = False,
) -> TactileSensor:
    """Load a sensor, which checks that it fits the scene; print an accepted difference to stderr.

    ``folder`` may also be the name of a scene with a shipped sensor. With ``jobs``, contacts are predicted first, with
    a progress bar. ``doubting``: where it has both readers, its description and the proportions of built-in solids are
    doubted, in place of the two arguments for that. Errors of a sensor for another scene say how to make a fitting one.
    """
    if folder is not None and folder.suffix == ".toml" and isinstance(choice, SceneChoice) and choice.pad is None:
        raise InvalidArgument(f"{folder} describes a pad: give it as --pad {folder}, and leave out --sensor")
    name, scene = (choice.scene, choice.named.scene) if isinstance(choice, SceneChoice) else ("", choice.scene)
    chosen = sensor_folder(folder, name, choice.pad if isinstance(choice, SceneChoice) else None)
    require_simulated(chosen)
    for path in (shipped_file(chosen / READER_FILE), observation_file(chosen, independent)):
        if not (path.is_file() or (chosen / ANY_OBJECT_FILE).is_file()):
            where = f"{chosen} holds no sensor: there is no {path.name} in it"
            none = f"no sensor comes with the scene {name}; name one with --sensor"
            raise NoSensor(f"{where if chosen.parent != MODELS else none}. {_remedy(choice, name, scene, chosen)}")
    try:
        path, fitted, _ = files_for(chosen, scene, anyway, independent, bool(unknown_state) or nested is True)
        if jobs is not None and fitted is None:
            from activetouch.perception.preparation import hypotheses_of

            reader = TactileReader.load(path).bound_to(scene)
            if (plan := TactileSensor.nested_plan(scene, independent, nested)) is not None:
                embed_all(reader, scene, plan, jobs)
            else:
                predict_contacts(reader, scene, hypotheses_of(reader, scene), jobs)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SceneShift)  # printed below, also where it is accepted
            options: dict[str, Any] = {"nested": nested, "other_proportions": other_proportions, "doubting": doubting}
            sensor = TactileSensor.load(chosen, scene, anyway, independent, unknown_state, **options)
    except (LabelMismatch, WrongScene) as error:
        remedy = _remedy(choice, name, scene, chosen)
        raise type(error)(f"{error}. {remedy}\nTo use it nevertheless, add --anyway.") from error
    for sentence in shift_sentences(sensor.shift):
        print(f"warning: {sentence}", file=sys.stderr)
    return sensor


def asked_state(unknown: bool, doubted: bool) -> bool | None:
    """Whether a sensor infers its state: always, never, or where touches are odd (None)."""
    if unknown and doubted:
        raise InvalidArgument("--unknown-state and --doubted-state contradict each other; leave one of them out")
    return None if doubted else unknown


def doubts(as_described: bool, unknown: bool, doubted: bool, other_proportions: bool) -> dict[str, Any]:
    """Arguments of :func:`open_sensor` for a sensor whose world may differ: all guards that it has, unless asked."""
    asked = unknown or doubted or other_proportions
    if as_described and asked:
        raise InvalidArgument("--as-described leaves out all doubts; leave it out, or the options that ask for one")
    state = asked_state(unknown, doubted)
    return {"unknown_state": state, "other_proportions": other_proportions, "doubting": not (as_described or asked)}


def embed_all(reader: TactileReader, scene: Scene, plan: NestedPlan, jobs: int | None = None) -> None:
    """Make the embeddings of bodies that are not in the cache, with a progress bar."""
    from activetouch.perception.contacts.views import to_embed  # few scenes need it

    plain = replace(scene, shapes=SCENES["gel"].scene.shapes)  # a task needs the state of the sensor, not all bodies
    if missing := to_embed(reader.hypotheses, scene, plan.views):
        tasks = [partial(_embed, reader.hypotheses, plain, solid, plan.views) for solid in missing]
        costs = list(map(view_seconds, missing))
        list(run_tasks(tasks, 1 if len(tasks) == 1 else jobs, f"views of {len(tasks)} bodies", costs, fills_cache=True))


def _embed(hypotheses: Any, scene: Scene, solid: Shape, views: ViewPlan) -> None:
    from activetouch.perception.contacts.views import embedded_views

    embedded_views(hypotheses, scene, solid, views)  # which stay in the cache


def view_seconds(solid: Shape) -> float:
    """Time of one core for the views of a body, roughly [s]."""
    return _VIEWS * _VIEW + _TRIANGLE * num_triangles(solid)


def num_triangles(solid: Shape) -> int:
    """Triangles of a mesh; 0 of another solid, which has few."""
    return len(getattr(solid, "faces", ()))


def predict_contacts(reader: TactileReader, scene: Scene, num_hypotheses: int, jobs: int | None) -> None:
    """Fill the cache of predicted contacts of a reader of any object, before one or several processes need them."""
    if reader.card.imaging is not None:
        shared = Shared(HypothesisTable(reader, scene))
        tasks = [partial(_predict, shared, num_hypotheses, pose) for pose in range(len(scene.poses))]
        for _ in run_tasks(tasks, jobs, "predicting contacts", fills_cache=True):
            pass


def _predict(shared: Shared[HypothesisTable], num_hypotheses: int, pose: int) -> None:
    shared.value.in_pose(num_hypotheses, pose)


def shift_sentences(shift: tuple[str, ...]) -> list[str]:
    """A sentence on the differences between the scene and that of the sensor; none if there are none."""
    return [f"The sensor was made for another scene: {in_words(shift)}."] if shift else []


def _remedy(choice: SceneChoice | NamedScene, name: str, scene: Scene, folder: Path) -> str:
    """What to do where the sensor of a folder does not read a scene."""
    has_own_pad = all((folder / name).is_file() for name in (PAD_FILE, ANY_OBJECT_FILE))
    if isinstance(choice, SceneChoice) and choice.pad is None and has_own_pad:
        return f"It was trained for a pad of your own: add --pad {folder / PAD_FILE}."
    if isinstance(choice, SceneChoice) and choice.pad is not None:
        train = command("train", pad=choice.pad, out=f"sensors/{choice.pad.stem}")
        return f"Leave out --sensor: one that comes with activetouch reads any pad. Or train it for this pad:\n{train}"
    ready = _shipped_for(name, scene)
    if ready is not None and ready == name:
        return f"Leave out --sensor: the sensor that comes with the scene {ready} reads these objects."
    if ready is not None:
        return f"Add --sensor {ready}: it reads any objects with this pad."
    if not isinstance(choice, SceneChoice):
        return "Make a sensor for this scene: activetouch.make_sensor(scene)"
    if choice.renderer is None and isinstance(scene.renderer, PressureRenderer):
        any_object = command("train", "--recipe", "contacts", scene=choice.scene, out=f"sensors/{choice_name(choice)}")
        return f"Make one for any objects with this pad:\n{any_object}"
    return "Make one with the commands collect, train and calibrate, of which each has the options of the scene."


def _shipped_for(own: str, scene: Scene) -> str | None:
    """Name of a shipped sensor that reads the objects of a scene with its pad; None if there is none."""
    for name in sorted(SCENES, key=lambda name: name != own):
        if SCENES[name].scene.image_shape[0] >= scene.image_shape[0]:  # coarser taxels would waste its images
            try:
                files_for(MODELS / name, scene)
            except ActiveTouchError:
                continue
            return name
    return None


def open_collection(folder: Path, scene: str, repeats: bool) -> Manifest:
    """Read the manifest of a collection; with ``repeats``, it must contain repeated touches."""
    from activetouch.data.manifest import NoCollection, read_manifest

    try:
        return read_manifest(folder)
    except NoCollection as error:
        options = REPEATS if repeats else ()
        raise NoCollection(
            f"{error}. Record one with: {command('collect', *options, scene=scene, out=folder)}"
        ) from error


def require_collection(
    folder: Path, manifest: Manifest, card: ClassifierCard | None, scene: str | None, anyway: bool = False
) -> None:
    """Check that a collection has the scene of a reader and of the results; print accepted differences to stderr.

    ``card`` is None if a reader is to be trained on it; ``scene`` is None if the user names the folder of the results.
    """
    wanted: dict[str, Mapping[str, Any] | None] = {}
    if card is not None:
        card.require_labels(manifest.shape_labels, manifest.pose_labels)
        wanted["the reader"] = card.in_poses_of(manifest.scene)
    if scene is not None:
        wanted[f"the scene {scene!r}"] = scene_fields(named_scene(scene).scene)
    shift: list[str] = []
    for whose, made_for in wanted.items():
        try:
            shift += require_scene(whose, made_for, manifest.scene, anyway)
        except WrongScene as error:
            remedy = "name a folder for the results with --out" if whose != "the reader" else "add --anyway"
            raise WrongScene(
                f"{error}. Such are the touches in {folder}; to use them nevertheless, {remedy}"
            ) from error
    if shift:
        told = in_words(tuple(dict.fromkeys(shift)))
        print(f"warning: {folder} was recorded in another scene than {' or '.join(wanted)}: {told}", file=sys.stderr)
    if card is not None:
        card.require_images(manifest.image_shape)
