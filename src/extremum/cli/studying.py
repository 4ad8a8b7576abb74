"""The command `study`."""

from __future__ import annotations

import argparse
import textwrap
import time
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import InvalidDescription
from ..studies import NAMES, Ready, ready
from ..studies.common import counted
from .files import Files
from .progress import Bar

if TYPE_CHECKING:
    import xarray

DPI = 150
WIDTH = 100


def study(options: argparse.Namespace) -> int:
    """Run one study or all; without a name, list them."""
    if options.name is None:
        for name in NAMES:
            known = ready(name)
            print(f"{name:<20}{known.loops:>9,} loops   {known.title}")
        return 0
    names = NAMES if options.name == "all" else (options.name,)
    wanted = {name: ready(name) for name in names}
    if options.loops is not None:
        counted(options.loops, max(one.least for one in wanted.values()))
    folder = Path(options.output)
    if folder.exists() and not folder.is_dir():
        raise InvalidDescription("", f"{folder} is a file; -o names the folder to write into")
    outputs = {name: _files(folder, name, one, options.force) for name, one in wanted.items()}
    folder.mkdir(parents=True, exist_ok=True)
    for name, one in wanted.items():
        with outputs[name] as files:
            _run(one, options.loops or one.loops, files)
            files.commit()
        print(f"wrote {', '.join(str(path) for path in files.paths.values())}\n")
    return 0


def _files(folder: Path, name: str, one: Ready, force: bool) -> Files:
    endings = {"data": ".nc", "plot": ".png"} | ({"animation": ".gif"} if one.animate else {})
    return Files({key: folder / f"{name}{end}" for key, end in endings.items()}, force)


def _run(one: Ready, loops: int, files: Files) -> None:
    begun = time.perf_counter()
    with Bar(one.title, loops, " loops", rate=True) as bar:
        found = one.study(loops, progress=lambda fraction: bar(fraction * loops))
    print(_summary(found, time.perf_counter() - begun))
    found.to_netcdf(files["data"], engine="h5netcdf")
    one.figure(found).savefig(files["plot"], dpi=DPI)
    if one.animate:
        with Bar("drawing the animation", 1.0, "") as bar:
            one.animate(found, files["animation"], progress=bar)


def _summary(found: xarray.Dataset, seconds: float) -> str:
    """Return what was run and found, as text."""
    finding = textwrap.fill(found.attrs["finding"], WIDTH)
    return f"{found.attrs['title']}\n{finding}\n{seconds:.3g} s"
