"""Beliefs about shapes: Bayes' rule in log space, calibration, observation models, exact coupled posteriors.

numpy and scipy only: importing this package loads no torch, no MuJoCo, no plotting. Each name of ``__all__`` loads its
module at first use, so that a program pays for what it uses.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from belief.naming import later

if TYPE_CHECKING:
    from belief.bayes import Belief
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

__getattr__, __dir__ = later(__name__)
