"""The bridge and the plant."""
