"""Observation models: p(touches | shape, poses), fitted to touches of objects outside the classifier's training set.

A classifier's softmax is an over-confident *posterior* under its training set; a product of such outputs counts the
prior once per touch (decision 0002). An observation model gives a likelihood instead. It takes all touches of one
object at once, so that it can discount repeated touches.

To add a model, derive from :class:`ArrayModel`, and enter it in
:data:`belief.observation_model.registry.OBSERVATION_MODELS`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from belief.naming import later

if TYPE_CHECKING:
    from belief.observation_model.confusion import ConfusionModel
    from belief.observation_model.embedded_hypotheses import FixedHypotheses
    from belief.observation_model.heavy_tails import HeavyTailsModel
    from belief.observation_model.likelihood_ratio import RatioModel
    from belief.observation_model.model import ArrayModel, ObservationModel, check_observation_model
    from belief.observation_model.outcome_table import OutcomeTable
    from belief.observation_model.plda import GaussianModel, PLDAModel
    from belief.observation_model.registry import read_observation_model, read_origin
    from belief.observation_model.rigid_body import FittedRigidBody, RigidBodyModel
    from belief.observation_model.selection import calibration_of_stops, certified_stops, fit_observation_model
    from belief.observation_model.sensor_health import SensorHealthModel
    from belief.observation_model.sensor_worlds import FixedWorlds, spread_prior

__all__ = [
    "ArrayModel",
    "ConfusionModel",
    "FittedRigidBody",
    "FixedHypotheses",
    "FixedWorlds",
    "GaussianModel",
    "HeavyTailsModel",
    "ObservationModel",
    "OutcomeTable",
    "PLDAModel",
    "RatioModel",
    "RigidBodyModel",
    "SensorHealthModel",
    "calibration_of_stops",
    "certified_stops",
    "check_observation_model",
    "fit_observation_model",
    "read_observation_model",
    "read_origin",
    "spread_prior",
]

__getattr__, __dir__ = later(__name__)
