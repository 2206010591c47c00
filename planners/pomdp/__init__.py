"""The search as a partially observable Markov decision process, and its point-based solver."""
