"""A bake as a page for browsers: what an export writes, and what a notebook shows."""

from skinbake.page.bake_page import bake_page

__all__ = ["bake_page"]
