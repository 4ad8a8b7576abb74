"""A record of samples, placed at the sampling instants."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Final

import numpy as np

from ..errors import InvalidDescription, shown

LONGEST: Final = 1e8
"""Sampling instants of a record."""


def placed(
    samples: Iterable[float | None], times: Sequence[float] | None, dt: float
) -> list[float | None]:
    """Return a sample for each instant, None where there is none.

    Parameters
    ----------
    samples
        In their order.
    times
        When they were taken (s), increasing; each belongs to the instant nearest to it. None: one
        at every instant.
    dt
        The time between two instants (s).

    Raises
    ------
    InvalidDescription
        For samples out of order, or two at the same instant.
    """
    try:
        record: list[Any] = list(samples)
    except TypeError:
        reason = "must be a list of numbers"
        raise InvalidDescription("samples", reason, shown(samples)) from None
    if times is None:
        return record
    stamps = np.asarray(times)
    real = stamps.dtype.kind in "iuf" or not stamps.size
    if not real or stamps.shape != (len(record),) or not np.isfinite(stamps).all():
        raise InvalidDescription(
            "times", f"must be one finite time (s) for each of the {len(record)} samples"
        )
    if not record:
        return record
    since = stamps.astype(float) - float(stamps[0])
    if since.max() / dt > LONGEST:
        raise InvalidDescription(
            "times", f"span more than {LONGEST:g} sampling instants of {dt!r} s"
        )
    places = np.rint(since / dt).astype(np.int64)
    late = np.flatnonzero(np.diff(places) <= 0)
    if len(late):
        k = int(late[0])
        after, before = float(stamps[k + 1]), float(stamps[k])
        raise InvalidDescription(
            "times",
            f"sample {k + 1} at {after!r} s comes before sample {k} at {before!r} s; sort them"
            if after < before
            else f"samples {k} and {k + 1} at {before!r} and {after!r} s belong to the same "
            f"instant: dt is {dt!r} s",
        )
    whole: list[float | None] = [None] * int(places[-1] + 1)
    for place, sample in zip(places.tolist(), record, strict=True):
        whole[place] = sample
    return whole
