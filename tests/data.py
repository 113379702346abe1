"""Where the project is, and where the test photographs are."""

import os
from pathlib import Path

ROOT = Path(__file__).parents[1]
# Tests on real photographs skip where this folder is not.
DATA = Path(os.environ.get("PANCHROMA_TEST_DATA", ROOT / "../shared/data"))
