"""Stand-ins for published robots, as text: tests replace parts of it."""

from pathlib import Path

TEST_MODELS = Path(__file__).parent / "models"
PANDA, FINGER = ((TEST_MODELS / f"{name}.xml").read_text() for name in ("panda", "finger"))
