"""Table for a terminal whose names wrap between their parts, and whose numbers never wrap."""

import dataclasses
import re
from collections.abc import Iterator, Mapping, Sequence

from rich import box
from rich.console import Console, ConsoleOptions
from rich.table import Table
from rich.text import Text

_NAME_PART = re.compile(r".[^/_, -]*[/_, -]*")  # a name may wrap after each part
_GAP = 2  # number of spaces between two columns


@dataclasses.dataclass(frozen=True)
class WrappedTable:
    """Table with columns of names and columns of numbers that fits the width of the terminal.

    If all columns of names together are too wide, a single one contains all names of a row. If the
    table is still too wide, the remaining columns of numbers follow in further tables.

    Attributes:
        names: cells of the columns of names, keyed by heading.
        numbers: cells of the columns of numbers, keyed by heading; a heading may have several
            lines.
        styles: style of each row; empty for no styles.
    """

    names: Mapping[str, Sequence[str]]
    numbers: Mapping[str, Sequence[str]]
    styles: Sequence[str] = ()

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[Table]:
        """Yield tables that fit the width of the console."""
        names = self.names
        if len(names) > 1 and _name_widths(names, self.numbers, options.max_width) is None:
            rows = zip(*names.values(), strict=True)
            names = {
                "case": [", ".join(map(" ".join, zip(names, row, strict=True))) for row in rows]
            }
        left = list(self.numbers)
        while left:
            for count in range(len(left), 0, -1):
                shown = {heading: self.numbers[heading] for heading in left[:count]}
                widths = _name_widths(names, shown, options.max_width)
                if widths is not None:
                    break
            yield self._table(names, shown, widths or [options.max_width])
            left = left[count:]

    def _table(
        self,
        names: Mapping[str, Sequence[str]],
        shown: Mapping[str, Sequence[str]],
        widths: Sequence[int],
    ) -> Table:
        table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, padding=(0, 1, 0, 0))
        for heading, width in zip(names, widths, strict=True):
            table.add_column(wrapped_name(heading, width), overflow="fold")
        for heading, cells in shown.items():
            width = _number_width(heading, cells)
            table.add_column(Text(heading), justify="right", no_wrap=True, width=width)
        for row, own in enumerate(zip(*names.values(), strict=True)):
            left = [wrapped_name(name, width) for name, width in zip(own, widths, strict=True)]
            right = [Text(column[row]) for column in shown.values()]
            table.add_row(*left, *right, style=self.styles[row] if self.styles else "")
        return table


def _name_widths(
    names: Mapping[str, Sequence[str]], numbers: Mapping[str, Sequence[str]], available: int
) -> list[int] | None:
    """Return the width of each column of names; None if the table is wider than `available`."""
    columns = [(heading, *cells) for heading, cells in names.items()]
    widths = [max(map(len, cells)) for cells in columns]
    least = [max(len(part) for cell in cells for part in name_parts(cell)) for cells in columns]
    available -= sum(_number_width(*column) for column in numbers.items())
    available -= _GAP * (len(names) + len(numbers) - 1)
    if sum(least) > available:
        return None
    while sum(widths) > available:
        widest = max(range(len(widths)), key=lambda i: (widths[i] > least[i], widths[i]))
        widths[widest] -= 1
    return widths


def _number_width(heading: str, cells: Sequence[str]) -> int:
    """Return the width of a column of numbers."""
    return max(map(len, (*heading.split("\n"), *cells)))


def name_parts(name: str) -> list[str]:
    """Return the parts of a name, such as ``front_`` and ``left``, between which it may wrap."""
    return [part.rstrip() for part in _NAME_PART.findall(name)] or [""]


def wrapped_name(name: str, width: int) -> Text:
    """Return a name with line breaks between its words, or between the parts of long words.

    Args:
        name: the name.
        width: limit on the number of characters per line.
    """
    lines = [""]
    for word in re.findall(r"\s*\S+\s*", name):
        for part in [word] if len(word.strip()) <= width else _NAME_PART.findall(word):
            if lines[-1] and len(lines[-1]) + len(part.rstrip()) > width:
                lines.append("")
            lines[-1] += part
    return Text("\n".join(line.rstrip() for line in lines))
