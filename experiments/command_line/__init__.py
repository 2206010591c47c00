"""Code shared by all commands: argument ranges, signals, worker processes and printing."""
