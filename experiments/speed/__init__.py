"""How fast the loop runs, beside bare physics."""
