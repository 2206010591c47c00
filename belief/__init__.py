"""Beliefs about shapes: Bayes' rule in log space, calibration, observation models, exact coupled posteriors.

numpy and scipy only: importing this package loads no torch, no MuJoCo, no plotting.
"""

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
