"""``touch``, ``gallery``, ``record``, ``view``, ``explain``, ``fidelity``, ``leak``: single presses."""
