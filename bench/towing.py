"""How well vehicles tow a welding cable: the plans alone."""

from __future__ import annotations

import sys

from _table import main
from _towing_plans import plan_rows

if __name__ == "__main__":
    sys.exit(main("a towed welding cable", plan_rows, sys.argv[1:]))
