"""Run times of this library and of other libraries for the same work: `make bench`."""
