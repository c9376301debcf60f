"""The command line, called in this process."""

from tjscan.cli import main


def tjscan(*arguments: object) -> int:
    """Run the command line in this process and return its exit code."""
    try:
        main([str(argument) for argument in arguments])
    except SystemExit as stop:
        return int(stop.code or 0)
    return 0
