"""Kill a sweep at its n-th operation on files, for many n; finish it, and compare the stores.

Usage: kill_points.py FOLDER STRIDE. Prints how many operations there are, and how many kills.
"""

from __future__ import annotations

import os
import shutil
import signal
import sys
from pathlib import Path

import closed_form
import zarr  # noqa: F401

from extremum.sweeps import running

OPERATIONS = ("open", "os.rename", "os.mkdir", "os.remove", "os.rmdir", "os.truncate", "os.chmod")
STUDY = closed_form.study(closed_form.DRAWN)


def child(store: Path, deadly: int | None, count: Path | None = None) -> int:
    """Run the sweep in a process of its own that dies before an operation; return its status."""
    pid = os.fork()
    if pid:
        return os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
    seen = [0]

    def operation(event: str, arguments: tuple) -> None:
        if event in OPERATIONS and store.name in str(arguments[0]):
            if seen[0] == deadly:
                os.kill(os.getpid(), signal.SIGKILL)
            seen[0] += 1

    sys.addaudithook(operation)
    closed_form.small_jobs(20)
    running.run(STUDY, store, closed_form.ensemble)
    if count is not None:
        count.write_text(str(seen[0]))
    os._exit(0)


def main(folder: Path, stride: int) -> None:
    whole, store, count = folder / "whole.zarr", folder / "store.zarr", folder / "count"
    assert child(whole, None, count) == 0
    expected = closed_form.contents(whole)
    kills = 0
    for deadly in range(0, int(count.read_text()), stride):
        assert child(store, deadly) == -signal.SIGKILL, deadly
        kills += 1
        assert child(store, None) == 0, deadly
        assert closed_form.contents(store) == expected, deadly
        left = {path.name for path in folder.iterdir()}
        assert left == {"whole.zarr", "store.zarr", "count"}, (deadly, left)
        shutil.rmtree(store)
    print(count.read_text(), kills)


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]))
