"""Compose worlds and deciders into runs: the command line, statistics, figures and reports."""
