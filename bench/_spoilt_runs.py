"""Run directories with one bit flipped or a file cut: read, read again, and gone on with."""

from __future__ import annotations

import os
import random
import shutil
import traceback
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final
from unittest.mock import patch

from _run_uses import Outcome, SoundRun, Use

from tjscan.core.errors import TjscanError

PICTURES: Final = (".png", ".html")
"""What nothing reads again."""


@dataclass(slots=True)
class SpoiltTally:
    """What became of spoilt run directories.

    Parameters
    ----------
    cases, refused, told : int
        How many uses of one, and of them how many were refused, or gave less and said so.
    silent, wrong : list of str
        Those that gave another result without a word, and those that ended in a traceback.
    """

    cases: int = 0
    refused: int = 0
    told: int = 0
    silent: list[str] = field(default_factory=list)
    wrong: list[str] = field(default_factory=list)


def spoil_runs(folder: Path, runs: Sequence[SoundRun], count: int, seed: int) -> SpoiltTally:
    """Flip a bit, or cut a file, of copies of the runs in turn, and use each in every way.

    Pictures are not drawn: no use reads one, and drawing takes most of the time.

    Parameters
    ----------
    folder : Path
        For the copies.
    runs : sequence of SoundRun
    count, seed : int
        How many; the same seed spoils the same bits.
    """
    dice, tally = random.Random(seed), SpoiltTally()
    with patch("tjscan.runs.scan.results.write_png"):
        for number in range(count):
            run = runs[number // 2 % len(runs)]
            copy = folder / f"{runs[0].recording}-{seed}-{number}"
            shutil.copytree(run.directory, copy)
            what, cut = _spoil(dice, copy, run.recording, flips=number % 2 == 0)
            for use in run.uses:
                _use(tally, copy, run.directory, use, what, cut=cut)
            shutil.rmtree(copy)
    return tally


def _use(tally: SpoiltTally, copy: Path, sound: Path, use: Use, what: str, *, cut: bool) -> None:
    tally.cases += 1
    name = f"{sound.name}: {what}: {use.__name__}"
    try:
        found = use(copy, cut)
    except TjscanError:
        tally.refused += 1
        return
    except Exception:
        tally.wrong.append(f"{name}\n{traceback.format_exc()}")
        return
    right = _right(sound, use, cut)
    if isinstance(right, Outcome) and found.same_result(right):
        return
    known = right.said if isinstance(right, Outcome) and not cut else frozenset()
    if found.said == known:  # a cut is told in the words of one that was there before
        tally.silent.append(name)
    else:
        tally.told += 1


@cache
def _right(sound: Path, use: Use, cut: bool) -> Outcome | str:
    """What comes of it where nothing was spoilt, or why it is refused."""
    with TemporaryDirectory(dir=sound.parent) as folder:
        copy = Path(folder) / "run"
        shutil.copytree(sound, copy)
        try:
            return use(copy, cut)
        except TjscanError as error:
            return str(error)


def _spoil(dice: random.Random, run: Path, recording: str, *, flips: bool) -> tuple[str, bool]:
    """Spoil a file, a recording as often as all others together; whether it is cut."""
    names = sorted(file.name for file in run.iterdir() if file.suffix not in PICTURES)
    name = recording if dice.random() < 0.5 else dice.choice(names)
    file = run / name
    data = bytearray(file.read_bytes())
    place = dice.randrange(len(data))
    if flips:
        data[place] ^= 1 << dice.randrange(8)
        file.write_bytes(data)
    else:
        os.truncate(file, place)
    what = f"{name} {'flipped' if flips else 'cut'} at {place} of {len(data)}"
    return what, name == recording and not flips
