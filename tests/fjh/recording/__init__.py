"""One machine in the loop, and its recordings."""
