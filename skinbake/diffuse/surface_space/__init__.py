"""Sums over skin points in millimetres: clusters, trees of sources, the exact integral."""
