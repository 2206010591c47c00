"""What may be read of a scene's joint belief, and nothing that changes it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NoReturn

from belief.categorical import Belief
from belief.history import TouchHistory
from belief.problem import Floats

if TYPE_CHECKING:
    from belief.scene_belief import ExactState, SceneBelief


class SceneView:
    """The joint belief about all objects as it was when the view was made, for reading only.

    Later touches do not show in it. It has no method that changes a belief, takes no attribute, and returns copies or
    what cannot be written to. :meth:`belief.scene_belief.SceneBelief.view` makes one.

    >>> from belief import SceneBelief, SearchProblem
    >>> from belief.synthetic import random_model
    >>> import numpy as np
    >>> model = random_model(np.random.default_rng(0))
    >>> scene = SceneBelief(SearchProblem(model.shape_labels, ("p0", "p1", "p2"), num_objects=2), model)
    >>> view = scene.view()
    >>> _ = scene.update(0, model.sample(0, [0], np.random.default_rng(0)))
    >>> len(scene.touches(0)), len(view.touches(0)), view.marginals()[0].tolist()
    (1, 0, [0.25, 0.25, 0.25, 0.25])
    """

    __slots__ = ("__scene",)

    def __init__(self, scene: SceneBelief) -> None:
        object.__setattr__(self, "_SceneView__scene", scene)

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of the K shapes."""
        return self.__scene.labels

    @property
    def num_objects(self) -> int:
        """N, those that are known or removed included."""
        return self.__scene.num_objects

    @property
    def state(self) -> ExactState:
        """See :attr:`belief.scene_belief.SceneBelief.state`."""
        return self.__scene.state

    def touches(self, object_index: int) -> TouchHistory:
        """See :meth:`belief.scene_belief.SceneBelief.touches`."""
        return self.__scene.touches(object_index)

    def marginals(self) -> Floats:
        """See :meth:`belief.scene_belief.SceneBelief.marginals`."""
        return self.__scene.marginals()

    def log_marginals(self) -> Floats:
        """See :meth:`belief.scene_belief.SceneBelief.log_marginals`."""
        return self.__scene.log_marginals()

    def log_likelihoods(self) -> Floats:
        """See :meth:`belief.scene_belief.SceneBelief.log_likelihoods`."""
        return self.__scene.log_likelihoods()

    def belief(self, object_index: int) -> Belief:
        """See :meth:`belief.scene_belief.SceneBelief.belief`."""
        return self.__scene.belief(object_index)

    def prob_present(self, target: int) -> float:
        """See :meth:`belief.scene_belief.SceneBelief.prob_present`."""
        return self.__scene.prob_present(target)

    def __setattr__(self, name: str, value: Any) -> NoReturn:
        raise AttributeError(f"a view of a scene is for reading only: {name} cannot be set")

    def __getattr__(self, name: str) -> NoReturn:
        raise AttributeError(
            f"a view of a scene has no {name!r}; it is for reading only: "
            f"{', '.join(name for name in dir(type(self)) if not name.startswith('_'))}"
        )

    def __reduce__(self) -> tuple[type[SceneView], tuple[SceneBelief]]:
        return SceneView, (self.__scene,)
