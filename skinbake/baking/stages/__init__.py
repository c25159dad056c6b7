"""Stages of a bake, one a module: what each imports is the code that its key stands for."""
