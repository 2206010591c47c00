"""Comparisons of deciders on live searches: ``compare``, ``replay`` and ``export``."""
