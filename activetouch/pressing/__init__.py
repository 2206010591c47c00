"""Ways to press an object against the pad, from a height map to a deformable pad."""
