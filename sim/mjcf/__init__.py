"""What an MJCF model says: elements, frames, drives, ranges, inertia, printed accuracy."""
