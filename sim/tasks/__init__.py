"""Task functions: what a robot is to do, each as an error and a Jacobian."""
