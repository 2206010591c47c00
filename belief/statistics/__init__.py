"""Intervals and comparisons for success rates, costs and returns.

What to use: Wilson intervals to show a rate, Clopper-Pearson to claim one; McNemar's test or the paired bootstrap where
two deciders met the same episodes; the cluster bootstrap where values come in groups that err together; the stratified
one where every target shape should count alike; Pareto fronts where cost and quality are traded.
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
