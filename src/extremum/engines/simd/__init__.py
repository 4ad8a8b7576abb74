"""The CPU engine: LLVM vector code, a vector of loops at a time."""

from .running import integrate as integrate
