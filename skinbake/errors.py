"""Errors that a user may meet, and the exit code each kind ends with.

Exit codes: 0 done, 1 a comparison differs or a tolerance was missed, 2 bad input, 3 the machine failed us.
"""

from __future__ import annotations

import unicodedata
from collections.abc import Sequence

MOST_FAULTS = 20  # what a person reads of one configuration
LONGEST = 1000  # characters of one fault


def printable(text: str) -> str:
    r"""Text without what would steer a terminal: control characters and the like as `\x1b`, line breaks and tabs kept.

    Bidirectional marks, with which a name reads otherwise than it is, are escaped too, and bytes of a path that are not
    UTF-8, which no stream takes.
    """
    return "".join(
        character
        if character in "\n\t" or unicodedata.category(character) not in ("Cc", "Cf", "Cs", "Zl", "Zp")
        else character.encode("unicode_escape").decode("ascii")
        for character in text
    )


class SkinbakeError(Exception):
    """A failure with a message for the person at the terminal; never shown as a traceback."""

    exit_code = 2


class InputError(SkinbakeError):
    """Something the user gave is unusable: the message names the file, what was expected and what came."""


class ConfigError(InputError):
    """Every fault of one configuration, each a line `file:line: key: expected ..., got ...`."""

    def __init__(self, faults: Sequence[str]) -> None:
        shown = [fault if len(fault) <= LONGEST else f"{fault[:LONGEST]} ..." for fault in faults[:MOST_FAULTS]]
        if len(faults) > MOST_FAULTS:
            shown.append(f"... and {len(faults) - MOST_FAULTS:,} more faults")
        super().__init__("\n".join(shown))
        self.faults = tuple(faults)


class ToleranceMissedError(SkinbakeError):
    """The bake is finished and written, but its measured error is above what was asked."""

    exit_code = 1


class MachineError(SkinbakeError):
    """Disk full, no OpenGL, out of memory: the message says what to do."""

    exit_code = 3
