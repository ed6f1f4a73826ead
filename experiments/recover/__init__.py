"""A strut fails in flight, and nobody says so."""
