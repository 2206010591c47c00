"""Calibration of a classifier's probabilities.

The default is :class:`StructuredMatrixScaling` (decision 0002): with few touches it equals temperature scaling, with
many it also corrects confusions of single shapes. :class:`PerPose` fits one calibration per pose, with
shrinkage.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from belief.naming import later

if TYPE_CHECKING:
    from belief.calibration.affine import CALIBRATIONS, DirichletCalibration, StructuredMatrixScaling, VectorScaling
    from belief.calibration.base import Calibration, Status, logits_from_probs
    from belief.calibration.per_pose import PerPose
    from belief.calibration.temperature import TemperatureScaling

__all__ = [
    "CALIBRATIONS",
    "Calibration",
    "DirichletCalibration",
    "PerPose",
    "Status",
    "StructuredMatrixScaling",
    "TemperatureScaling",
    "VectorScaling",
    "logits_from_probs",
]

__getattr__, __dir__ = later(__name__)
