"""Bounds on the expected return of any decider for the discretised sensor model."""
