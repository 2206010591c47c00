"""``tradeoff``: success against time over many configurations."""
