"""``collect``, ``train``, ``calibrate``: making a tactile sensor."""
