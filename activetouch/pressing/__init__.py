"""Ways to press an object against the pad, from an elastic foundation to a deformable pad."""
