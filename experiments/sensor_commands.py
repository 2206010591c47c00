"""Command lines as text, and those that make a sensor for a scene."""

from __future__ import annotations

import shlex
from dataclasses import fields
from pathlib import Path

from activetouch.mesh_source import mesh_labels
from activetouch.rendering import PressureRenderer
from activetouch.sensor_files import READER_FILE
from belief.errors import ActiveTouchError
from experiments.scene_choice import (
    SceneChoice,
    collection_folder,
    in_file_names,
    named_scene,
    renderer_named,
    repeats_folder,
    training_folder,
)

REPEATS = ("--plan.train", "0", "--plan.repeats", "6")
"""Options of ``collect`` for the touches that a sensor is calibrated with."""


def command(name: str, *words: object, **options: object) -> str:
    """A command line, such as ``command("train", scene="gel")``; options that are None are omitted."""
    told = [str(word) for word in words]
    for option, value in options.items():
        if value is not None:
            told += [f"--{option.replace('_', '-')}", str(value)]
    return shlex.join(["activetouch", name, *told])


def scene_words(choice: SceneChoice) -> list[str]:
    """Command-line arguments that select a scene with its changes."""
    words = ["--scene", choice.scene]
    for field in fields(SceneChoice):
        value = getattr(choice, field.name)
        if field.name != "scene" and value != field.default:
            words.append(f"--{field.name.replace('_', '-')}")
            if not isinstance(value, bool):
                words += [str(part) for part in value] if isinstance(value, tuple) else [str(value)]
    return words


def choice_name(choice: SceneChoice) -> str:
    """The name of a scene with its changes, as used in folder names."""
    changes = [
        choice.fidelity,
        choice.renderer,
        choice.presentation,
        choice.poses,
        "only" if choice.only else None,
        *mesh_labels(*choice.meshes),
        choice.hand,
    ]
    return in_file_names("-".join([choice.scene, *(change for change in changes if change)]))


def sensor_commands(choice: SceneChoice) -> str:
    """The commands that make a sensor for a scene, one per line, and the flags that select it.

    If its images are of pressure, the first makes a sensor of any objects; the others one of its own objects.
    """
    name = choice_name(choice)
    data, repeats, trained = collection_folder(name), repeats_folder(name), training_folder(name)
    sensor, scene = Path(f"runs/sensor-{name}"), scene_words(choice)
    lines = [
        command("collect", *scene, out=data),
        command("collect", *scene, *REPEATS, out=repeats),
        command("train", scene=choice.scene, data=data, out=trained),
        command("calibrate", scene=choice.scene, data=repeats, reader=trained / READER_FILE, out=sensor),
        f"Then name its folder with --sensor {sensor}.",
    ]
    if _can_learn_any_object(choice):
        of_any = Path("sensors") / in_file_names(choice.scene)
        lines[:0] = [
            command("train", "--recipe", "contacts", scene=choice.scene, out=of_any),
            f"Then name its folder with --sensor {of_any}; it reads any objects with this pad.",
            "Or make a sensor for these objects alone, which is better after one or two touches:",
        ]
    return "\n".join(lines)


def _can_learn_any_object(choice: SceneChoice) -> bool:
    try:
        renderer = named_scene(choice.scene).scene.renderer
    except ActiveTouchError:  # it is an object, which no command can name
        return False
    is_own = choice.renderer is None or renderer_named(choice.renderer) == renderer
    return is_own and isinstance(renderer, PressureRenderer)
