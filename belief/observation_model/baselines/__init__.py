"""Observation models that `calibration-report` and `tradeoff` compare the default model with.

The default is :class:`belief.observation_model.likelihood_ratio.RatioModel`.
"""
