"""The registry of calibrations."""

from __future__ import annotations

from collections.abc import Sequence

from belief.calibration.affine import DirichletCalibration, StructuredMatrixScaling, VectorScaling
from belief.calibration.base import Calibration, read_json
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


def calibration_from_json(text: str, shape_labels: Sequence[str]) -> Calibration:
    """The calibration of any class in a text; errors as for :meth:`Calibration.from_json`.

    >>> calibration_from_json(TemperatureScaling(2.0, "ok").to_json(["cube", "cone"]), ["cube", "cone"])
    TemperatureScaling(temperature=2.0, status='ok', floor=0.0)
    """
    return read_json(text, CALIBRATIONS, shape_labels)
