"""Blurs across the texture: separable Gaussians, stretched ones, and where they go wrong."""
