"""Pictures of recordings, made by the viewer's own headless mode."""
