"""``limit``: estimates of the Bayes-optimal accuracy of one touch."""
