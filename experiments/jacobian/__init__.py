"""Is the Jacobian constant? Eq. (40) with a certificate, and what it means in the loop."""
