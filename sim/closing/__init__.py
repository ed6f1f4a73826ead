"""Closed loops: equalities, fixed joints and frames, and joint positions that close them."""
