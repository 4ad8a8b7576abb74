"""Numbers in memory: slots of a block, rows of all loops, and their two precisions."""

from __future__ import annotations

from ..lanes.frame import WIDE
from .emitter import Emitter
from .flow import Flow
from .layout import Layout


class Memory:
    """Writes loads and stores of one function.

    Attributes
    ----------
    vector, double, plain
        Emitters of vectors of states, of vectors of doubles, and of single doubles.
    flow
        Control flow and addresses.
    """

    def __init__(self, layout: Layout) -> None:
        self.layout = layout
        self.vector = Emitter(layout.width, layout.bits, contract=True)
        self.double = self.vector.like(bits=64)
        self.plain = self.vector.like(width=1, bits=64)
        self.flow = Flow(self.plain)

    def load(self, address: str, emitter: Emitter, align: int = 0) -> str:
        """Return a vector of numbers; aligned as vectors are unless said."""
        align = align or emitter.width * emitter.bits // 8
        return emitter.value(f"load {emitter.type}, ptr {address}, align {align}")

    def store(self, value: str, address: str, emitter: Emitter) -> None:
        """Store a vector that may lie anywhere."""
        emitter.line(f"store {emitter.type} {value}, ptr {address}, align 4")

    def put(self, value: str, address: str, emitter: Emitter) -> None:
        """Store a vector where vectors are aligned."""
        align = emitter.width * emitter.bits // 8
        emitter.line(f"store {emitter.type} {value}, ptr {address}, align {align}")

    def precision(self, name: str) -> Emitter:
        """Return the emitter of a row's numbers."""
        return self.double if name.startswith(WIDE) else self.vector

    def shared(self, place: int) -> str:
        """Return the address of what is the same for all loops."""
        return self.flow.at("%u", place, self.vector.element)

    def narrowed(self, name: str, emitter: Emitter) -> str:
        """Return double precision numbers in the precision of the states."""
        if self.layout.bits == 64:
            return name
        target = self.vector.element if emitter.width == 1 else self.vector.type
        return emitter.value(f"fptrunc {emitter.type} {name} to {target}")

    def widened(self, name: str) -> str:
        """Return the states' numbers in double precision."""
        if self.layout.bits == 64:
            return name
        return self.plain.value(f"fpext {self.vector.type} {name} to {self.double.type}")

    def row(self, base: str, row: int, vector: str, element: str) -> str:
        """Return the address of a vector's loops in a row of `stride` numbers."""
        flow = self.flow
        start = flow.whole("mul", "%stride", row)
        place = flow.whole("mul", vector, self.layout.width)
        return flow.at(base, flow.whole("add", start, place), element)

    def slots(self, g: str) -> dict[str, str]:
        """Return the addresses of a vector's slots in its block."""
        base = self.flow.at("%buffer", self.flow.whole("mul", g, self.layout.size))
        return {name: self.flow.at(base, offset) for name, offset in self.layout.offsets.items()}
