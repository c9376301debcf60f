"""What differs between operating systems stands in one file each, with a way round for Windows."""

import os
import re
import signal
import sys
import threading
from pathlib import Path
from types import SimpleNamespace

import pytest

import tjscan
from tjscan.core import files, locks, signals
from tjscan.core.errors import RecordingError
from tjscan.core.files import write_files_atomically

PACKAGE = Path(tjscan.__file__).parent

HOMES = {
    "core/locks.py": {"fcntl", "msvcrt"},
    "core/signals.py": {"signal"},
    "core/files.py": {"fsync"},
}
"""Files and what they alone may use."""

USES = re.compile(
    r"^\s*(?:import|from) (fcntl|grp|msvcrt|posix|pty|pwd|resource|signal|termios|tty)\b"
    r"|\bos\.(fork|fsync|getuid|killpg|mkfifo|O_DIRECTORY|register_at_fork)\b",
    re.MULTILINE,
)
"""Of modules and of os, what Windows has not or has otherwise."""


def test_each_kind_has_one_home() -> None:
    for file in PACKAGE.rglob("*.py"):
        name = file.relative_to(PACKAGE).as_posix()
        used = {a or b for a, b in USES.findall(file.read_text(encoding="utf-8"))}
        assert used == HOMES.get(name, set()), name


def test_without_fcntl_a_file_beside_the_directory_is_locked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    locked: list[int] = []

    def locking(handle: int, mode: int, length: int) -> None:
        if locked:
            raise PermissionError(13, "Permission denied")
        locked.append(handle)

    monkeypatch.setattr(locks, "fcntl", None)
    monkeypatch.setitem(sys.modules, "msvcrt", SimpleNamespace(locking=locking, LK_NBLCK=2))
    run = tmp_path / "run"
    with pytest.raises(RecordingError, match="can't be opened"), locks.lock_directory(run):
        pass
    run.mkdir()
    with locks.lock_directory(run):
        assert os.fstat(locked[0]).st_ino == locks.lock_file_of(run).stat().st_ino
        assert list(run.iterdir()) == []  # a run is only made in an empty directory
        with (
            pytest.raises(RecordingError, match="another process"),
            locks.lock_directory(run),
        ):
            pass


def test_where_directories_cannot_be_opened_files_are_written_all_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[tuple[str, int]] = []

    def open_no_directory(path: Path, flags: int) -> int:
        assert not path.is_dir()
        opened.append((path.name, flags))
        return real(path, flags)

    real = os.open
    monkeypatch.setattr(files, "IS_WINDOWS", True)
    monkeypatch.setattr(files, "os", SimpleNamespace(**{**vars(os), "open": open_no_directory}))
    with write_files_atomically(tmp_path) as draft:
        (draft / "a.txt").write_text("a", encoding="utf-8")
    assert (tmp_path / "a.txt").read_text(encoding="utf-8") == "a"
    assert opened == [("a.txt", os.O_RDWR)]


def test_without_signals_to_threads_ctrl_c_is_pressed_and_waited_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for name in ("pause", "pthread_kill", "SIGTTIN"):
        monkeypatch.delattr(signal, name, raising=False)
    signals.survive_background_terminal_read()
    presser = threading.Thread(target=signals.interrupt_main_thread)

    def be_interrupted() -> None:
        presser.start()
        signals.wait_for_ctrl_c()

    with signals.handle_ctrl_c(raise_interrupt), pytest.raises(KeyboardInterrupt):
        be_interrupted()
    presser.join()


def raise_interrupt() -> None:
    raise KeyboardInterrupt
