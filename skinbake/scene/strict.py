"""The base of every configuration model: unknown keys are faults, values never change after parsing."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field
from pydantic_core.core_schema import no_info_after_validator_function


class Also:
    """Says in the JSON schema that a key may be written shorter, as a validator before it understands.

    Parameters
    ----------
    type : str
        Of JSON: "string", "number", ...
    **limits
        Of JSON schema: `minimum`, `maximum`, `exclusiveMinimum`, `enum`, ...
    """

    def __init__(self, type: str, **limits: Any) -> None:
        self.type, self.limits = type, limits

    def __get_pydantic_json_schema__(self, core_schema: Any, handler: Any) -> dict[str, Any]:
        return {"anyOf": [handler(core_schema), {"type": self.type, **self.limits}]}


class Between:
    """Limits of a number, both of which the message names, with the reason where there is one to tell.

    Parameters
    ----------
    low, high : float
        Both allowed.
    why : str
        Put after the range.
    """

    def __init__(self, low: float, high: float, why: str = "") -> None:
        self.low, self.high = low, high
        self.expected = f"expected {low:g} to {high:g}{f', {why}' if why else ''}"

    def _checked(self, value: float) -> float:
        if not self.low <= value <= self.high:
            raise ValueError(f"{self.expected}; got {value:g}")
        return value

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        return no_info_after_validator_function(self._checked, handler(source))

    def __get_pydantic_json_schema__(self, core_schema: Any, handler: Any) -> dict[str, Any]:
        return {**handler(core_schema), "minimum": self.low, "maximum": self.high}


class Strict(BaseModel):
    """Frozen model that refuses unknown keys and non-finite numbers."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


LARGEST = 1e30  # what is computed in single precision is sums and products of a few of these with less
Positive = Annotated[float, Field(gt=0, le=LARGEST)]
NonNegative = Annotated[float, Field(ge=0, le=LARGEST)]
Fraction = Annotated[float, Field(ge=0, le=1)]
Vector = tuple[float, float, float]
Rgb = tuple[NonNegative, NonNegative, NonNegative]
