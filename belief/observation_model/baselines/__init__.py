"""Baseline observation models, with which `calibration-report` and `tradeoff` compare the default, ``RatioModel``."""
