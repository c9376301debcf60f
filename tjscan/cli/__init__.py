"""The command line: one file per command, nothing heavy before a command needs it."""

from __future__ import annotations

import errno
import logging
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from cyclopts import App, CycloptsError, Group

from tjscan.core import errors
from tjscan.core.signals import exit_on_termination
from tjscan.core.version import PROGRAM_VERSION

# Its matrices are small: threads would only wait for each other. Workers inherit it.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


class _TjscanApp(App):
    """The program; its shell completion offers the keys of jobs."""

    def install_completion(self, **options: Any) -> Path:
        """Install the script of completion, see `App.install_completion`."""
        from tjscan.cli.options.completion import job_keys_as_options

        with job_keys_as_options(self):
            return super().install_completion(**options)


HELP_GROUPS: Final = {
    "Begin": ("init", "joint", "place", "schema"),
    "Set up a cell": ("accept", "calibrate", "doctor", "laser", "teach"),
    "Scan": ("scan", "reprocess", "stitch"),
    "See and use what was scanned": ("compare", "export", "groove", "report", "view"),
    "Weld": ("plan", "weld", "inspect"),
    "Drive vehicles": ("crawl", "tow"),
    "Study": ("chain", "study"),
    "Simulate devices on this machine": (
        "laser-loopback",
        "power-loopback",
        "ur-loopback",
        "vehicle-loopback",
    ),
}
"""Commands in the program's help, by what one wants."""

_GROUPS_IN_ORDER: Final = [
    Group(title, sort_key=number) for number, title in enumerate(HELP_GROUPS)
]
GROUP_OF_COMMAND: Final = {
    name: group
    for group, names in zip(_GROUPS_IN_ORDER, HELP_GROUPS.values(), strict=True)
    for name in names
}

app = _TjscanApp(
    name="tjscan",
    help="Scan the weld groove of large tubular T-joints with a robot arm and a line laser.",
    version=PROGRAM_VERSION,
    suppress_keyboard_interrupt=False,
)
crawl_app = App(name="crawl", help="Follow a hull's joint with a magnetic crawler, and weld it.")
tow_app = App(name="tow", help="Tow a welding cable with several vehicles, in an optimised shape.")
weld_app = App(name="weld")
for its_app in (crawl_app, tow_app, weld_app):
    its_app.group = GROUP_OF_COMMAND[its_app.name[0]]
    app.command(its_app)

COMMAND_GROUPS: Final = (
    (app, "scan", ("scan", "teach", "doctor", "laser", "reprocess", "stitch")),
    (app, "place", ("place",)),
    (app, "calibrate", ("calibrate",)),
    (app, "accept", ("accept",)),
    (app, "results", ("groove", "compare", "export", "report", "view")),
    (app, "plan", ("plan",)),
    (app, "weld", ("inspect",)),
    (weld_app, "weld", ("calibrate",)),
    (app, "study", ("study", "chain")),
    (app, "files", ("joint", "init", "schema")),
    (crawl_app, "crawl", ("run", "size", "calibrate", "register", "compare", "replay")),
    (tow_app, "tow", ("run", "replay", "identify")),
)
"""Commands by group: the module, and the functions in it.

The docstring of a function is the help of its command.
"""

for group, module, functions in COMMAND_GROUPS:
    for function in functions:
        title = GROUP_OF_COMMAND[function] if group is app else None
        group.command(f"tjscan.cli.{module}:{function}", name=function, group=title)
app.register_install_completion_command()

LOOPBACK_COMMANDS: Final = (
    "ur-loopback",
    "laser-loopback",
    "vehicle-loopback",
    "power-loopback",
)
"""Commands that the distribution tjscan-loopback adds by entry points, as any package may."""

EXIT_CODES: dict[type[errors.TjscanError], int] = {
    errors.ConfigurationError: 2,
    errors.ArmFault: 4,
    errors.LaserFault: 4,
    errors.VehicleFault: 4,
    errors.PowerFault: 4,
    errors.WeldStopped: 4,
    errors.ScanInterrupted: 130,
}
"""Exit code of each branch of the error tree; 1 for the rest."""


SYSTEM_LIBRARY_ADVICE: Final = (
    "A library of the system is missing. Those that are needed, on Debian and Ubuntu: apt-get "
    "install libegl1 libgl1 libgomp1 libidn2-0 libudev1 libusb-1.0-0 libx11-6"
)
"""What to do if one can't be loaded."""


def exit_code_of_error(error: errors.TjscanError) -> int:
    """Exit code of the program after an error."""
    return next((code for kind, code in EXIT_CODES.items() if isinstance(error, kind)), 1)


def add_commands_of_packages() -> None:
    """Add the commands that other packages bring by entry points; the program's own stay."""
    from importlib.metadata import entry_points  # needs 60 modules that no other command needs

    for command in entry_points(group="tjscan.command"):
        if command.name not in app:
            title = GROUP_OF_COMMAND.get(command.name)
            app.command(command.value, name=command.name, group=title)


def _load_commands(tokens: Sequence[str]) -> None:
    """Load the commands that a page of help lists, whose docstrings it shows, or that is unknown.

    Raises
    ------
    ConfigurationError
        If there is no such command, or it is of a loopback device whose package is missing.
    """
    words = tuple(token for token in tokens if not token.startswith("-"))
    if words[:1] in ((), ("weld",)) and weld_app.default_command is None:
        from tjscan.cli.weld import weld  # which has a command below it, and is one

        weld_app.default(weld)
    if not words or words[0] not in app:
        add_commands_of_packages()
    if words and words[0] in LOOPBACK_COMMANDS and words[0] not in app:
        raise errors.ConfigurationError(
            f"'tjscan {words[0]}' needs the package tjscan-loopback, which is not installed: "
            "pip install ./loopback in the checkout of tjscan"
        )
    if words and words[0] not in app and words[0] == tokens[0]:
        known = [name for name in app if not name.startswith("-")]
        raise errors.ConfigurationError(
            f"there is no command {words[0]!r}; did you mean: "
            f"{errors.nearest_word(words[0], known)}?"
        )
    listings = {(): app, ("crawl",): crawl_app, ("tow",): tow_app, ("weld",): weld_app}
    if words in listings:
        listings[words].resolved_commands()


def main(tokens: Sequence[str] | None = None) -> None:
    """Run the command line and turn errors into one message and an exit code."""
    tokens = sys.argv[1:] if tokens is None else tokens
    # A library would log what the message of an error already states.
    logging.getLogger("trimesh").propagate = False
    logging.getLogger("trimesh").addHandler(logging.NullHandler())
    try:
        _load_commands(tokens)
        # A program that is ended stops its arm and writes what it has, as after Ctrl-C.
        with exit_on_termination():
            try:
                app(tokens, exit_on_error=False, print_error=True)
            finally:
                sys.stdout.flush()
    except CycloptsError:
        sys.exit(2)
    except errors.TjscanError as error:
        print(f"tjscan: {errors.message_with_notes(error)}", file=sys.stderr)
        sys.exit(exit_code_of_error(error))
    except ImportError as error:
        if ".so" not in str(error):
            raise
        print(f"tjscan: {error}. {SYSTEM_LIBRARY_ADVICE}", file=sys.stderr)
        sys.exit(1)
    except BrokenPipeError:
        sys.exit(0)  # the reader of the output has closed it
    except OSError as error:
        if error.errno == errno.ENAMETOOLONG:
            name = f"{error.filename!s:.60}…"
            print(f"tjscan: too long for the name of a file: {name}", file=sys.stderr)
            sys.exit(2)
        if error.errno != errno.ENOSPC:
            raise
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # what is left goes nowhere
        print("tjscan: the output can't be written: no space is left there", file=sys.stderr)
        sys.exit(1)
    except KeyboardInterrupt:
        print("tjscan: interrupted", file=sys.stderr)
        sys.exit(130)
