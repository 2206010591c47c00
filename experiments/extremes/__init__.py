"""``stress``: numerical and physical extremes."""
