"""``touch``, ``gallery``, ``record``, ``view``, ``explain``, ``leak``: single presses."""
