"""Ways to press an object against the pad, with or without simulated time."""
