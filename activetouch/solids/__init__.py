"""Solids with exact ray geometry and a collision geom for MuJoCo."""
