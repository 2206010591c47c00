"""``recorded``: searches among recorded objects."""
