"""The program as ``python -m tjscan``, for where scripts are not on the path."""

from tjscan.cli import main

main()
