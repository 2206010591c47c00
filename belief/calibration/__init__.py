"""Calibrate a classifier: make "90 % sure" right nine times out of ten.

:class:`StructuredMatrixScaling` is the one to take: with few touches it is temperature scaling, with many it corrects
what one temperature cannot, a shape that is over-confident or taken for another. :func:`choose_calibration` compares by
cross-validation, :class:`PerPose` calibrates each pose by itself as far as its touches carry.
"""

from belief.calibration.base import Calibration, Status
from belief.calibration.choice import Choice, choose_calibration
from belief.calibration.dirichlet import DirichletCalibration
from belief.calibration.per_pose import PerPose
from belief.calibration.structured import StructuredMatrixScaling
from belief.calibration.table import CALIBRATIONS, calibration_from_json
from belief.calibration.temperature import TemperatureScaling
from belief.calibration.vector import VectorScaling

__all__ = [
    "CALIBRATIONS",
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
