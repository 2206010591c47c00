"""Calibration of a classifier's probabilities.

The default is :class:`StructuredMatrixScaling` (decision 0022): with few touches it equals temperature scaling, with
many it also corrects confusions of single shapes. :func:`choose_calibration` compares calibrations by cross-validation;
:class:`PerPose` fits one calibration per pose, with shrinkage.
"""

from belief.calibration.base import Calibration, Status
from belief.calibration.beta import BetaCalibration
from belief.calibration.choice import Choice, choose_calibration
from belief.calibration.dirichlet import DirichletCalibration
from belief.calibration.per_pose import PerPose
from belief.calibration.structured import StructuredMatrixScaling
from belief.calibration.table import CALIBRATIONS, calibration_from_json
from belief.calibration.temperature import TemperatureScaling
from belief.calibration.vector import VectorScaling

__all__ = [
    "CALIBRATIONS",
    "BetaCalibration",
    "Calibration",
    "Choice",
    "DirichletCalibration",
    "PerPose",
    "Status",
    "StructuredMatrixScaling",
    "TemperatureScaling",
    "VectorScaling",
    "calibration_from_json",
    "choose_calibration",
]
