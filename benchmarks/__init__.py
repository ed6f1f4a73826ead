"""Times of this library beside those of others: `make bench`."""
