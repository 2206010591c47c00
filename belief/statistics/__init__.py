"""Intervals and comparisons for success rates, costs and returns.

Use Wilson intervals to show a rate, and Clopper-Pearson intervals for guaranteed coverage. Use McNemar's test or the
paired bootstrap for two deciders on the same episodes, the cluster bootstrap for groups of values with correlated
errors, and the Pareto front for trade-offs of cost and quality.
"""

from belief.statistics.comparison import (
    McNemar,
    clopper_pearson_interval,
    cluster_bootstrap,
    mcnemar_test,
    paired_bootstrap,
    pareto_front,
    wilson_interval,
)

__all__ = [
    "McNemar",
    "clopper_pearson_interval",
    "cluster_bootstrap",
    "mcnemar_test",
    "paired_bootstrap",
    "pareto_front",
    "wilson_interval",
]
