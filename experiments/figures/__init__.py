"""Figures 2 and 3 of the paper from the machine and the loop that run; Bode plot; failure atlas."""
