"""Many bodies in front of a sensor that reads any object: which, what they cost, and the sensor among them."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from activetouch import TactileSensor
from activetouch.distributions import Uniform
from activetouch.errors import MeshWarning, SceneShift
from activetouch.mesh_source import MeshSource, read_files
from activetouch.named_scenes import SCENES
from activetouch.perception.contacts.hypotheses import ContactHypotheses
from activetouch.perception.contacts.views import ViewPlan, to_embed
from activetouch.perception.many_bodies import PRESSED, TOUCHES, NestedPlan, is_fitted
from activetouch.perception.reader import TactileReader
from activetouch.scene import Scene
from activetouch.sensor_files import ANY_OBJECT_FILE, MODELS, PAD_FILE
from activetouch.solids.mesh import Mesh
from activetouch.solids.solid import Shape
from belief.errors import InvalidArgument
from belief.observation_model.nested_bodies import NestedBodyModel
from experiments.sensor_choice import embed_all, num_triangles, sensor_folder, view_seconds

SIZES = (0.97, 1.03)
"""Smallest and largest size of an object, relative to its mesh."""
_WIDE = {"stiffness": 3.0, "law": 1.5}  # largest by smallest value, above which a pad is not known well
_MANY = 200  # bodies, above which a touch takes no more time
# Seconds of one core, roughly, by time.process_time, of 4 to 100 icospheres of 320 to 82 000 triangles with waves:
_READING = 0.15  # of a megabyte of a file
_TOUCH, _SEARCHED = 0.0045, 0.04  # of a touch of the fit, and of a search, beside those for each body
_CHECKS = 18.0  # of the presses of probable bodies in the fit
_REPORT = 0.22  # of a touch in the report


def sensor_of(
    solids: Mapping[str, Shape], sensor: str | Path = "gel", plan: NestedPlan | None = None, jobs: int | None = None
) -> TactileSensor:
    """The sensor among many bodies; those that are not in the cache are embedded, on several processes.

    Args:
        solids: bodies by label.
        sensor: a shipped sensor with a reader of any object, or a folder of one.
        plan: how closely bodies are examined.
        jobs: number of processes; as many as processors by default.

    Raises:
        InvalidArgument: there are no bodies, or the sensor has no reader of any object.
    """
    if not solids:
        raise InvalidArgument("there are no bodies: give at least one mesh")
    scene, plan = scene_of(solids, sensor), NestedPlan() if plan is None else plan
    if (pad := pad_of(sensor)) is not None and (wide := _wide_ranges(pad)):
        warnings.warn(
            f"the {wide} of this pad may be anything in a wide range, and a belief about many bodies takes the middle: "
            "fit the pad to presses of a ball first (activetouch pad-fit)",
            SceneShift,
            stacklevel=2,
        )
    embed_all(reader_of(sensor), scene, plan, jobs)
    return TactileSensor.load(folder_of(sensor), scene, nested=plan)


def _wide_ranges(pad: Path) -> str:
    """What a description leaves open by more than a fit to a ball would, in words; empty for nothing."""
    from activetouch.pad_file import read_pad  # other sensors do not need it

    ranges = read_pad(pad).response.ranges()
    wide = {name: ranges[name][1] / ranges[name][0] for name in _WIDE}
    return " and ".join(name for name, ratio in wide.items() if ratio > _WIDE[name])


def model_of(sensor: TactileSensor) -> NestedBodyModel:
    """The observation model of many bodies of a sensor."""
    assert isinstance(sensor.model, NestedBodyModel), "the sensor of many bodies has no other"
    return sensor.model


def plan_of(plan: ViewPlan | None = None, **others: Any) -> NestedPlan:
    """How closely bodies are examined, by the arguments of :func:`activetouch.find`; None for the usual."""
    given = {**others, "views": plan}
    if levels := given.get("levels"):
        given["levels"] = tuple(levels)
    return NestedPlan(**{name: value for name, value in given.items() if value is not None})


def sources_of(folder: Path | Sequence[Path | str]) -> Sequence[Path | str]:
    """A folder ``path[@scale]``, which must be there, or files one by one, as :func:`activetouch.read_meshes` takes."""
    if not isinstance(folder, Path | str):
        return folder
    if not (root := MeshSource.parse(folder).path).is_dir():
        raise FileNotFoundError(f"there is no folder {root}; relative paths start from {Path.cwd()}")
    return [folder]


def read_folder(folder: Path | Sequence[Path | str], scale: float | None = None) -> tuple[dict[str, Mesh], list[str]]:
    """The meshes of :func:`sources_of`, and a line on each file that is left out."""
    return read_files(*sources_of(folder), scale=scale, is_lenient=True)


def scene_of(solids: Mapping[str, Shape], sensor: str | Path = "gel") -> Scene:
    """The scene of a sensor with other bodies, pressed from 26 directions, whose sizes vary by 3 %."""
    own = SCENES[str(sensor)].scene if str(sensor) in SCENES else SCENES["gel"].scene
    if (pad := pad_of(sensor)) is not None:
        from activetouch.pad_file import read_pad

        own = read_pad(pad).scene(own)
    varied = replace(own.variation, size=Uniform(*SIZES))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MeshWarning)  # the caller is told of twins in another way
        return replace(own, shapes=dict(solids), poses="directions26", variation=varied)


def folder_of(sensor: str | Path) -> Path:
    """The folder of a sensor, as :func:`experiments.sensor_choice.sensor_folder` finds it."""
    return sensor_folder(Path(sensor), "")


def pad_of(sensor: str | Path) -> Path | None:
    """The file that describes the pad of a sensor; None where that is the square of a scene."""
    path = folder_of(sensor) / PAD_FILE
    return path if path.is_file() else None


def reader_of(sensor: str | Path) -> Any:
    """The reader of any object of a sensor; InvalidArgument if it has none."""
    folder = folder_of(sensor)
    for name in (ANY_OBJECT_FILE, "reader.safetensors"):
        if (folder / name).is_file():
            reader = TactileReader.load(folder / name)
            if isinstance(reader.hypotheses, ContactHypotheses):
                return reader
    known = ", ".join(sorted(path.parent.name for path in MODELS.glob(f"*/{ANY_OBJECT_FILE}")))
    raise InvalidArgument(
        f"the sensor {sensor} has no reader of any object; of those that ship, these have one: {known}"
    )


def reading_words(sources: Mapping[str, MeshSource]) -> str:
    """How long it takes to read mesh files, before they are read."""
    size = sum(source.path.stat().st_size for source in sources.values() if source.path.exists()) / 1e6
    return f"reading {len(sources)} files of {size:.1f} MB: about {_in_words(size * _READING)}"


def cost_words(solids: Mapping[str, Shape], sensor: str | Path, touches: float, pictured: float, jobs: int) -> str:
    """Words on the cost of bodies that are not in the cache, and of the touches, of which the report shows some."""
    reader, plan, number = reader_of(sensor), NestedPlan(), len(solids)
    scene = scene_of(solids, sensor)
    missing = to_embed(reader.hypotheses, scene, plan.views)
    triangles = float(np.mean([num_triangles(one) for one in solids.values()]))
    views = sum(map(view_seconds, missing)) / jobs
    is_new = not is_fitted(reader, scene, plan)
    fit = is_new * (_CHECKS + PRESSED * TOUCHES * (_TOUCH + 5e-4 * min(number, _MANY)))
    play = touches * (_SEARCHED + 2.2e-3 * min(number, _MANY) + 5e-6 * triangles) / jobs
    report, size = 1.0 + _REPORT * pictured, number * len(plan.views.orientations) * reader.card.embedding / 1e6
    return (
        f"{number} bodies: about {_in_words(views + fit + play + report)}, of which {_in_words(views)} for "
        f"{len(plan.views.orientations)} views of each of {len(missing)} new bodies and {_in_words(fit)} for the "
        f"fit of the set, once, {_in_words(play)} for about {touches:.0f} touches and {_in_words(report)} for "
        f"the report; {2 * size:.0f} MB on disk, {4 * size:.0f} MB in memory"
    )


def _in_words(seconds: float) -> str:
    return f"{seconds / 60:.0f} min" if seconds > 100 else f"{seconds:.0f} s"
