"""Errors that a user may meet, and the exit code each kind ends with.

Exit codes: 0 done, 1 a comparison differs or a tolerance was missed, 2 bad input, 3 the machine failed us.
"""

from __future__ import annotations

from collections.abc import Sequence

MOST_FAULTS = 20  # what a person reads of one configuration
LONGEST = 1000  # characters of one fault


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
