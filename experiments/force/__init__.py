"""Forces exerted and held: Theorems 7 to 9 in simulation, sound and failed."""
