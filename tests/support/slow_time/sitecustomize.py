"""Time that goes at a quarter of its speed, for Python programs whose PYTHONPATH leads here.

A busy machine then has four times as long for what programs over a wire do in real time.
"""

import time

SLOWNESS = 4.0
monotonic, sleep = time.monotonic, time.sleep
time.monotonic = lambda: monotonic() / SLOWNESS
time.sleep = lambda seconds: sleep(SLOWNESS * float(seconds))
