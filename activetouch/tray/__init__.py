"""Objects that lie in a tray, at places that nobody knows: how they rest, what a press there meets, and its reading."""
