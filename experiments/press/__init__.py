"""``touch``, ``gallery``, ``record``, ``view``, ``explain``: single presses."""
