"""The sample head: sculpted from named anatomical parts, unwrapped and painted by `data/make_head.py`."""
