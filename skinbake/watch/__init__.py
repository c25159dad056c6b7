"""A look baked again whenever it is saved: a draft at once, in memory, then as it asks, in a process of its own."""
