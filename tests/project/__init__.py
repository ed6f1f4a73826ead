"""The project itself: rooms, pages, wheel, workflows."""
