"""Loops, branches and addresses of a function that an `Emitter` writes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import count

from .emitter import Emitter


class Flow:
    """Writes control flow; indices are 64-bit integers.

    Parameters
    ----------
    plain
        The function's emitter of single numbers.
    """

    def __init__(self, plain: Emitter) -> None:
        self.plain = plain
        self._labels = count()
        self._block = "entry"

    def truth(self, text: str) -> str:
        """Write an instruction; return the name of its result."""
        return self.plain.value(text)

    def whole(self, operation: str, a: str, b: str | int) -> str:
        """Return an operation on indices: "add", "sub", "mul"."""
        return self.plain.value(f"{operation} i64 {a}, {b}")

    def least(self, a: str, b: int) -> str:
        """Return the smaller index."""
        return self.plain.value(
            f"select i1 {self.plain.value(f'icmp ult i64 {a}, {b}')}, i64 {a}, i64 {b}"
        )

    def at(self, base: str, offset: str | int, element: str = "i8") -> str:
        """Return the address of an element."""
        return self.plain.value(f"getelementptr {element}, ptr {base}, i64 {offset}")

    def any(self, mask: str, width: int) -> str:
        """Return whether one lane of a mask is true."""
        if width == 1:
            return mask
        bits = self.plain.value(f"bitcast <{width} x i1> {mask} to i{width}")
        return self.plain.value(f"icmp ne i{width} {bits}, 0")

    def enter(self, label: str) -> None:
        """Begin a basic block."""
        self.plain.lines.append(f"{label}:")
        self._block = label

    @contextmanager
    def where(self, condition: str) -> Iterator[None]:
        """Run the body only if the condition holds."""
        number, line = next(self._labels), self.plain.line
        line(f"br i1 {condition}, label %then{number}, label %after{number}")
        self.enter(f"then{number}")
        yield
        line(f"br label %after{number}")
        self.enter(f"after{number}")

    @contextmanager
    def loop(self, bound: str) -> Iterator[str]:
        """Run the body for 0 … bound − 1; gives the index."""
        number, before, line = next(self._labels), self._block, self.plain.line
        index, following = f"%i{number}", f"%n{number}"
        line(f"br label %head{number}")
        self.enter(f"head{number}")
        line(f"{index} = phi i64 [ 0, %{before} ], [ {following}, %latch{number} ]")
        line(f"%c{number} = icmp ult i64 {index}, {bound}")
        line(f"br i1 %c{number}, label %body{number}, label %after{number}")
        self.enter(f"body{number}")
        yield index
        line(f"br label %latch{number}")
        self.enter(f"latch{number}")
        line(f"{following} = add i64 {index}, 1")
        line(f"br label %head{number}")
        self.enter(f"after{number}")

    def rounds(self, queue: str, length: str, stop: str, body: Callable[[str], str]) -> None:
        """Go round a queue of indices, again and again, until none has more to do.

        `body` writes what is done for one index, and returns whether there is more to do. A number
        other than 0 at `stop` ends it after a round.
        """
        number, before, line = next(self._labels), self._block, self.plain.line
        line(f"br label %round{number}")
        self.enter(f"round{number}")
        line(f"%left{number} = phi i64 [ {length}, %{before} ], [ %m{number}, %head{number} ]")
        line(f"%stop{number} = load volatile i64, ptr {stop}, align 8")
        line(f"%some{number} = icmp ne i64 %left{number}, 0")
        line(f"%free{number} = icmp eq i64 %stop{number}, 0")
        line(f"%more{number} = and i1 %some{number}, %free{number}")
        line(f"br i1 %more{number}, label %head{number}, label %after{number}")
        self.enter(f"head{number}")
        ways = (f"%round{number}", f"%latch{number}")
        line(f"%j{number} = phi i64 [ 0, {ways[0]} ], [ %j.next{number}, {ways[1]} ]")
        line(f"%m{number} = phi i64 [ %left{number}, {ways[0]} ], [ %m.next{number}, {ways[1]} ]")
        line(f"%c{number} = icmp ult i64 %j{number}, %m{number}")
        line(f"br i1 %c{number}, label %body{number}, label %round{number}")
        self.enter(f"body{number}")
        place = self.at(queue, f"%j{number}", "i64")
        index = self.plain.value(f"load i64, ptr {place}, align 8")
        more = body(index)
        line(f"br label %latch{number}")
        self.enter(f"latch{number}")
        gone = self.plain.value(f"zext i1 {self.plain.value(f'xor i1 {more}, true')} to i64")
        line(f"%m.next{number} = sub i64 %m{number}, {gone}")
        kept = self.plain.value(f"zext i1 {more} to i64")
        line(f"%j.next{number} = add i64 %j{number}, {kept}")
        end = self.at(queue, self.whole("sub", f"%m{number}", 1), "i64")
        other = self.plain.value(f"load i64, ptr {end}, align 8")
        chosen = self.plain.value(f"select i1 {more}, i64 {index}, i64 {other}")
        line(f"store i64 {chosen}, ptr {place}, align 8")
        line(f"br label %head{number}")
        self.enter(f"after{number}")
