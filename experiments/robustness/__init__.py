"""``robustness``: the sensor under faults, shifted objects and other presses."""
