"""Beliefs about shapes: Bayes' rule in log space, calibration, observation models, exact coupled posteriors.

numpy and scipy only: importing this package loads no torch, no MuJoCo, no plotting.
"""

from belief.categorical import Belief
from belief.errors import ActiveTouchError, ImpossibleObservation
from belief.problem import Composition, Confirm, Probe, Reject, SearchProblem, Touch
from belief.tracker import BeliefTracker, SceneBelief

__all__ = [
    "ActiveTouchError",
    "Belief",
    "BeliefTracker",
    "Composition",
    "Confirm",
    "ImpossibleObservation",
    "Probe",
    "Reject",
    "SceneBelief",
    "SearchProblem",
    "Touch",
]
