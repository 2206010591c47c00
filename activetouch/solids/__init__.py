"""Solids as triangles, their height maps, and a collision geom for MuJoCo."""
