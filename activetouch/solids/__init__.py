"""Solids with exact ray geometry for touch images and a collision geom for MuJoCo; the tables are in ``shapes``."""
