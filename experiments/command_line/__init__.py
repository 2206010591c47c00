"""What every command shares: ranges of arguments, signals, and what is printed."""
