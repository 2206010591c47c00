"""Collections of recorded touches."""
