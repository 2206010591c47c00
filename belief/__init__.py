"""Beliefs about shapes: Bayes' rule in log space, calibration, observation models, exact coupled posteriors.

numpy and scipy only: importing this package loads no torch, no MuJoCo, no plotting. Each name of ``__all__`` loads its
module at first use, so that a program pays for what it uses.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from belief.categorical import Belief
    from belief.composition import Composition, Counts
    from belief.errors import ActiveTouchError, ImpossibleObservation, ZeroPriorTarget
    from belief.history import TouchHistory
    from belief.observation_model.evidence import ObjectEvidence
    from belief.problem import Confirm, Probe, Reject, SearchProblem, Touch, Unsure
    from belief.scene_belief import SceneBelief
    from belief.scene_view import SceneView
    from belief.tracker import BeliefTracker

__all__ = [
    "ActiveTouchError",
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
    "ActiveTouchError": ".errors",
    "Belief": ".categorical",
    "BeliefTracker": ".tracker",
    "Composition": ".composition",
    "Confirm": ".problem",
    "Counts": ".composition",
    "ImpossibleObservation": ".errors",
    "ObjectEvidence": ".observation_model.evidence",
    "Probe": ".problem",
    "Reject": ".problem",
    "SceneBelief": ".scene_belief",
    "SceneView": ".scene_view",
    "SearchProblem": ".problem",
    "Touch": ".problem",
    "TouchHistory": ".history",
    "Unsure": ".problem",
    "ZeroPriorTarget": ".errors",
}


def __getattr__(name: str) -> Any:
    """A public name, from the module that defines it."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    found = globals()[name] = getattr(importlib.import_module(_HOMES[name], __name__), name)
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
