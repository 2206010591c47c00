"""Intervals and comparisons for success rates, costs and returns.

Use Wilson intervals to show a rate, and Clopper-Pearson intervals where the coverage must be guaranteed. Use McNemar's
test or the paired bootstrap where two deciders play the same episodes, the cluster bootstrap where groups of values
have correlated errors, the stratified bootstrap where every stratum counts alike, and a Pareto front where cost and
quality are traded.
"""

from belief.statistics.bootstrap import cluster_bootstrap, paired_bootstrap, stratified_bootstrap
from belief.statistics.mcnemar import McNemar, mcnemar_test
from belief.statistics.pareto import pareto_front, pareto_probabilities
from belief.statistics.proportion import clopper_pearson_interval, wilson_interval

__all__ = [
    "McNemar",
    "clopper_pearson_interval",
    "cluster_bootstrap",
    "mcnemar_test",
    "paired_bootstrap",
    "pareto_front",
    "pareto_probabilities",
    "stratified_bootstrap",
    "wilson_interval",
]
