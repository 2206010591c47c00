"""Searches among objects that lie in a tray at places that nobody knows."""
