"""``calibration-report``: how well stated probabilities agree with observed frequencies."""
