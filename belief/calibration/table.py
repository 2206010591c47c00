"""The registry of calibrations."""

from __future__ import annotations

from belief.calibration.affine import DirichletCalibration, StructuredMatrixScaling, VectorScaling
from belief.calibration.base import Calibration
from belief.calibration.temperature import TemperatureScaling

CALIBRATIONS: dict[str, type[Calibration]] = {
    calibration.name: calibration
    for calibration in (
        TemperatureScaling,
        VectorScaling,
        StructuredMatrixScaling,
        DirichletCalibration,
    )
}
"""Classes by name, the simplest first."""
