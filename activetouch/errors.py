"""What can go wrong in the world and its sensor, one class per mistake."""

from __future__ import annotations

from belief.errors import ActiveTouchError


class WrongMujoco(ActiveTouchError, ImportError):
    """The installed MuJoCo has contact faults that change touches."""


class UnstablePress(ActiveTouchError, RuntimeError):
    """The physics of a press diverged or MuJoCo warned; no touch can be trusted."""


class LabelMismatch(ActiveTouchError, ValueError):
    """A model was made for other shapes or poses than the scene has."""


class WrongScene(ActiveTouchError, ValueError):
    """A sensor, a collection or a bank was made for another scene than it is to be used in."""


class SceneShift(UserWarning):
    """A sensor is used in a scene that differs from its own by a known shift."""


class WrongRenderer(ActiveTouchError, TypeError):
    """A renderer does not keep the rule of renderers (:class:`activetouch.rendering.TactileRenderer`)."""


class WrongPress(ActiveTouchError, TypeError):
    """Something needs another way to press than the scene has: one that moves, or one that rotates."""


class MissingPackage(ActiveTouchError, ImportError):
    """Something optional is not installed; the message says what and how to get it."""


class MissingRobot(ActiveTouchError, FileNotFoundError):
    """The robot's model files are not where they were looked for."""


class BadMesh(ActiveTouchError, ValueError):
    """A mesh is no solid object of a size that can be felt; the message says why and what to do."""


class MissingWeights(ActiveTouchError, OSError):
    """Published weights to start from are not where they were looked for, or belong to another network."""


class ImpossibleRecipe(ActiveTouchError, ValueError):
    """A setting of a training is out of its range."""


class TrainingDiverged(ActiveTouchError, ArithmeticError):
    """A gradient is not finite, so that no step can be made with it."""


class UnknownLikelihood(ActiveTouchError, TypeError):
    """The probability of a reading is not known in closed form for the faults of a sensor."""
