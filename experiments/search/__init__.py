"""Comparisons of deciders on live searches: ``compare``, ``merge``, ``replay``, ``export`` and ``overprobing``."""
