"""The rig lives at the top of the repository, beside the product and apart from it."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
