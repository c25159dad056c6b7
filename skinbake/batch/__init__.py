"""Batches: many looks from one file, baked by this machine's processes or a cluster's, a folder each."""
