"""Handing over: a bake as files that other programs read."""
