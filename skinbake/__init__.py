"""Texture-space diffusion of human skin: irradiance baked to UV space, blurred by a physical profile, added up live."""

__version__ = "0.1.0"
