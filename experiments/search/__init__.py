"""``compare``, ``merge``, ``replay``, ``overprobing``: live searches and what is told of them."""
