"""Beliefs about shapes: Bayes' rule in log space, calibration, observation models, exact coupled posteriors.

numpy and scipy only: importing this package loads no torch, no MuJoCo, no plotting. Each name of ``__all__`` loads its
module at first use, so that a program pays for what it uses.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from belief.categorical import Belief
    from belief.composition import AtMostOne, Composition, Counts
    from belief.errors import ActiveTouchError, ImpossibleObservation, ZeroPriorTarget
    from belief.observation_model.evidence import ObjectEvidence
    from belief.problem import Confirm, Probe, Reject, SearchProblem, Touch, TouchHistory, Unsure
    from belief.scene_belief import BeliefTracker, SceneBelief, SceneView

__all__ = [
    "ActiveTouchError",
    "AtMostOne",
    "Belief",
    "BeliefTracker",
    "Composition",
    "Confirm",
    "Counts",
    "ImpossibleObservation",
    "ObjectEvidence",
    "Probe",
    "Reject",
    "SceneBelief",
    "SceneView",
    "SearchProblem",
    "Touch",
    "TouchHistory",
    "Unsure",
    "ZeroPriorTarget",
]

_HOMES = {
    "categorical": "Belief",
    "composition": "AtMostOne Composition Counts",
    "errors": "ActiveTouchError ImpossibleObservation ZeroPriorTarget",
    "observation_model.evidence": "ObjectEvidence",
    "problem": "Confirm Probe Reject SearchProblem Touch TouchHistory Unsure",
    "scene_belief": "BeliefTracker SceneBelief SceneView",
}


def __getattr__(name: str) -> Any:
    """A public name, from the module that defines it."""
    for home, names in _HOMES.items():
        if name in names.split():
            found = globals()[name] = getattr(importlib.import_module(f"belief.{home}"), name)
            return found
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
