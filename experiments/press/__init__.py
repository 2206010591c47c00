"""``touch`` and ``explain``: single presses, and what a scene models."""
