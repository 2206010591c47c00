"""Find and identify bodies among many meshes, without training."""
