"""Identifiers that C, C++ and Python accept, and prefixes that make some."""

from __future__ import annotations

import keyword
import re
from collections.abc import Iterable
from typing import Final

from ..errors import InvalidDescription, shown

_WORDS: Final = """
alignas alignof and and_eq asm auto bitand bitor bool break case catch char char8_t char16_t
char32_t class co_await co_return co_yield compl concept const const_cast consteval constexpr
constinit continue decltype default delete do double dynamic_cast else enum explicit export
extern false float for friend goto if inline int long mutable namespace new noexcept not not_eq
nullptr operator or or_eq private protected public register reinterpret_cast requires restrict
return short signed sizeof static static_assert static_cast struct switch template this
thread_local throw true try typedef typeid typename typeof typeof_unqual union unsigned using
virtual void volatile wchar_t while xor xor_eq
"""
_FILES: Final = """
assert complex ctype errno fenv float inttypes iso646 limits locale math setjmp signal stdalign
stdarg stdatomic stdbit stdbool stdckdint stddef stdint stdio stdlib stdnoreturn string tgmath
threads time uchar wchar wctype
"""
KEYWORDS: Final = frozenset(_WORDS.split())
"""Of C and C++, up to C23 and C++20."""
_HEADERS: Final = frozenset(_FILES.split())
_TYPES: Final = re.compile(
    r"u?int(_fast|_least)?(8|16|32|64|ptr|max)|s?size|ptrdiff|max_align|nullptr|char(8|16|32)|wchar"
    r"|wint|wctype|wctrans|mbstate|l?l?div|imaxdiv|time|clock|fpos|sig_atomic|fenv|fexcept|off|pid"
    r"|float|double|va_list|cnd|mtx|thrd|tss|once_flag|constraint_handler|errno|rsize"
)
"""What becomes a standard type with ``_t`` behind it."""


def check_prefix(prefix: object) -> str:
    """Return a prefix of C names.

    Raises
    ------
    InvalidDescription
        Unless it is an identifier of C, C++ and Python, no keyword of theirs, does not begin with
        an underscore, and is no standard header or, with ``_t`` behind it, a standard type.
    """
    if not isinstance(prefix, str):
        raise InvalidDescription("prefix", "must be text", shown(prefix))
    reason = ""
    if not re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", prefix):
        reason = "is no identifier of C: a letter, then letters, digits and underscores"
    elif prefix.startswith("_"):
        reason = "begins with an underscore, which C reserves for its compilers"
    elif "__" in prefix:
        reason = "has two underscores in a row, which C++ reserves for its compilers"
    elif prefix in KEYWORDS:
        reason = "is a keyword of C or C++"
    elif keyword.iskeyword(prefix):
        reason = "is a keyword of Python"
    elif prefix.lower() in _HEADERS:
        reason = f"would hide the standard header <{prefix.lower()}.h>"
    elif _TYPES.fullmatch(prefix):
        reason = f"is taken: {prefix}_t is a standard type"
    if reason:
        raise InvalidDescription("prefix", f"{reason}; take another, such as esc", shown(prefix))
    return prefix


class Names:
    """Identifiers that differ from each other, from keywords and from what is taken."""

    def __init__(self, taken: Iterable[str]) -> None:
        self._taken = {*taken, *KEYWORDS, *keyword.kwlist}

    def fresh(self, name: str) -> str:
        """Return an identifier like `name`; v1, v2, … are left to statements."""
        plain = re.sub(r"\W+", "_", name, flags=re.ASCII).strip("_")
        if not plain or re.match(r"\d|v\d+$", plain):
            plain = f"x_{plain}"
        while plain in self._taken:
            plain += "_"
        self._taken.add(plain)
        return plain
