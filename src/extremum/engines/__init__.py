"""Engines: a `System` and numbers in, a `Trajectory` out. They know nothing of extremum seeking."""
