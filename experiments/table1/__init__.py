"""Table I and Figures 4 to 6: six tracking experiments of section 4.2."""
