"""Proofs about the averaged loop over a box of uncertain numbers."""

from .characteristic import characteristic, coupled
from .hessians import hessian_eigenvalues, prove_identical
from .proofs import Counterexample, Proof, largest_decay, prove

__all__ = [
    "Counterexample",
    "Proof",
    "characteristic",
    "coupled",
    "hessian_eigenvalues",
    "largest_decay",
    "prove",
    "prove_identical",
]
