"""The networks that read tactile images, and their training."""
