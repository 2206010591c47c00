"""``robustness``: measure a sensor under faults, other objects, other presses and unknown shapes."""
