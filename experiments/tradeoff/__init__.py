"""The command ``tradeoff``: success against time of many configurations."""
