"""Light that the sum of Gaussians leaves out, each term decided by its own number."""
