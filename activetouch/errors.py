"""Errors and warnings of the world and its sensor."""

from __future__ import annotations

import sys
import warnings

from belief.errors import ActiveTouchError

_WITHIN = ("activetouch", "belief", "planners", "experiments", "functools")


class WrongMujoco(ActiveTouchError, ImportError):
    """The installed MuJoCo is too old: its contacts have faults that change touches."""


class UnstablePress(ActiveTouchError, RuntimeError):
    """The simulation of a press diverged, or MuJoCo warned."""


class LabelMismatch(ActiveTouchError, ValueError):
    """A model was made for other shapes or poses than the scene has."""


class WrongScene(ActiveTouchError, ValueError):
    """A sensor, a collection or a bank was made for another scene."""


class NoIndependentModel(ActiveTouchError, FileNotFoundError):
    """A sensor has no observation model that takes touches as independent given the shape."""


class SceneShift(UserWarning):
    """A sensor is used in a scene that differs from its own by a known shift."""


class WrongRenderer(ActiveTouchError, TypeError):
    """A renderer violates the rules of :class:`activetouch.rendering.TactileRenderer`."""


class BadMesh(ActiveTouchError, ValueError):
    """A mesh is not a solid of a suitable size; the message says why and what to do."""


class DuplicateShape(ActiveTouchError, ValueError):
    """Two shapes of a scene would have the same name."""


class AlikeShapes(UserWarning):
    """Simulated touches tell the shapes of a scene apart too rarely."""


class MeshWarning(UserWarning):
    """A mesh is read, and is not quite what its file says, or not one closed solid; the message says what it means."""


def warn_of(message: str, category: type[Warning]) -> None:
    """Warn with the line of the user that led here: the innermost one outside of this project."""
    level, frame = 1, sys._getframe()
    while frame.f_back and frame.f_globals.get("__name__", "").partition(".")[0] in _WITHIN:
        level, frame = level + 1, frame.f_back
    warnings.warn(message, category, stacklevel=level)


class MissingWeights(ActiveTouchError, OSError):
    """Published weights are not there, or are of another network."""


class ImpossibleRecipe(ActiveTouchError, ValueError):
    """A setting of a training is out of its range."""


class TrainingDiverged(ActiveTouchError, ArithmeticError):
    """A gradient, a loss, a weight or an output of a training is not finite."""


class BadRecording(ActiveTouchError, ValueError):
    """Recorded touches cannot be read or used; the message says which file, line or touch, and what would work."""
