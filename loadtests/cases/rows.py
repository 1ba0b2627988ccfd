"""Rows of the table: expected, found, and whether it holds."""

from dataclasses import asdict, dataclass

OK, NOT, LATER, UNCHECKED = "ok", "NOT", "later", "none"
# Longest error line that is shown.
SHOWN_CHARS = 160


@dataclass
class Row:
    """`later`: the picture comes with a later issue, and its warning until then is there. `none`: no
    reader here reads the file, so nothing is judged."""

    name: str
    expected: str
    found: str
    state: str

    def __str__(self) -> str:
        return f"{self.state:<6}{self.name:<40} expected {self.expected}; found {self.found}"

    def json(self) -> dict:
        return asdict(self)


def row(name: str, expected: str, found: str, holds: bool) -> Row:
    return Row(name, expected, found, OK if holds else NOT)


def later(name: str, expected: str, found: str, shown: bool, warned: bool) -> Row:
    """A row that a later issue makes right: until then its warning is asked for."""
    return Row(name, expected, found, OK if shown else LATER if warned else NOT)


def metres(value: float) -> str:
    return f"{value:.4g} m"


def short(text: str) -> str:
    line = " ".join(text.split())
    return line if len(line) <= SHOWN_CHARS else line[: SHOWN_CHARS - 1] + "…"
