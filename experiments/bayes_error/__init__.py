"""``limit``: estimate the Bayes-optimal accuracy of one touch."""
