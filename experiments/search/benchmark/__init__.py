"""``activetouch benchmark``: task cards, submissions of agents, and their check."""
