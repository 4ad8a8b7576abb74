"""The command `export c`."""

from __future__ import annotations

import argparse
import sys
import warnings
from pathlib import Path

from ..deploy.discrete import DiscreteController, discretize
from ..deploy.exporting import exported
from ..errors import InvalidDescription
from ..sampled.loop import SampledLoop
from ..scenario import Scenario, load_scenario
from .files import Files
from .inputs import in_file, load


def export_c(options: argparse.Namespace) -> int:
    """Write a scenario's controller as a C header, a Python file and a README."""
    scenario = load(options.scenario, load_scenario)
    precision = "single" if options.single else "double"
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always", UserWarning)
        try:
            texts = exported(_sampled(scenario, options.dt), options.prefix, precision)
        except InvalidDescription as error:
            own = error.path in ("dt", "prefix")
            raise error if own else in_file(error, options.scenario) from None
    folder = Path(options.output)
    if folder.exists() and not folder.is_dir():
        raise InvalidDescription("", f"{folder} is a file; -o names the folder to write into")
    outputs = Files({name: folder / name for name in texts}, options.force)
    folder.mkdir(parents=True, exist_ok=True)
    with outputs as files:
        for name, text in texts.items():
            files[name].write_text(text, encoding="utf-8")
        files.commit()
    for warning in warned:
        print(f"extremum: warning: {warning.message}", file=sys.stderr)
    print(f"wrote {', '.join(str(path) for path in outputs.paths.values())}")
    return 0


def _sampled(scenario: Scenario, dt: float | None) -> DiscreteController:
    """Return a scenario's controller as it runs on samples."""
    loop = scenario.loop
    sampling = loop.sampling if isinstance(loop, SampledLoop) else None
    if sampling is not None:
        period: float = sampling.dt if dt is None else dt
        return discretize(loop.controller, period, practice=sampling.practice, vehicle=loop.vehicle)
    if dt is None:
        reason = "must be given, the time between two samples in s: the file has no [sampling]"
        raise InvalidDescription("dt", reason)
    return discretize(loop.controller, dt, vehicle=loop.vehicle)
