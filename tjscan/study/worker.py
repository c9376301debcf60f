"""Loaded by every worker process of this machine before it runs anything.

Ctrl-C reaches all processes of a terminal: it is for the one that hands out the work.
"""

from __future__ import annotations

from tjscan.core.signals import ignore_ctrl_c

ignore_ctrl_c()
