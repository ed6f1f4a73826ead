"""Closed loops: their equalities, what is held meanwhile, and positions that close them."""
