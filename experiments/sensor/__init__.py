"""``collect``, ``train``, ``calibrate``, ``learning-curve``, ``frontier``: making a tactile sensor."""
