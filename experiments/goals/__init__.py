"""The goals of the paper's abstract, pursued beside the major task."""
