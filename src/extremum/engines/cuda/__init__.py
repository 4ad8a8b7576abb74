"""The GPU engine: a kernel of numba-cuda, a thread a loop."""

from .running import available as available
from .running import integrate as integrate
