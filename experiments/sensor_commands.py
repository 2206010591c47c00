"""Command lines as text."""

from __future__ import annotations

import shlex

from activetouch.mesh_source import mesh_labels
from experiments.scene_choice import SceneChoice, in_file_names

REPEATS = ("--plan.train", "0", "--plan.repeats", "6")
"""Options of ``collect`` for the touches that a sensor is calibrated with."""


def command(name: str, *words: object, **options: object) -> str:
    """A command line, such as ``command("train", scene="gel")``; options that are None are omitted."""
    told = [str(word) for word in words]
    for option, value in options.items():
        if value is not None:
            told += [f"--{option.replace('_', '-')}", str(value)]
    return shlex.join(["activetouch", name, *told])


def choice_name(choice: SceneChoice) -> str:
    """The name of a scene with its changes, as used in folder names."""
    changes = [choice.fidelity, choice.renderer, choice.presentation, choice.poses, "only" if choice.only else None]
    changes += [*mesh_labels(*choice.meshes), *choice.family, choice.hand]
    return in_file_names("-".join([choice.scene, *(change for change in changes if change)]))
