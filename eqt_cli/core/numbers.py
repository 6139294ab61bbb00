"""Annotated types for numbers in a configuration; importing it costs nothing.

`Real` accepts a finite number or a constant expression such as ``-pi/2``. Components use it for
their options; pydantic calls the hooks below when a configuration is validated.
"""

from __future__ import annotations

from typing import Annotated, Any

from eqt_cli.core.errors import ExpressionError
from eqt_cli.core.expressions import constant


class _FiniteReal:
    """Marks a float that may also be written as a constant expression."""

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        from pydantic_core import core_schema

        return core_schema.no_info_before_validator_function(
            _evaluated, core_schema.float_schema(strict=True, allow_inf_nan=False)
        )

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any) -> dict[str, Any]:
        return {"anyOf": [{"type": "number"}, {"type": "string", "description": "such as -pi/2"}]}


def _evaluated(value: Any) -> Any:
    if not isinstance(value, str):
        return value
    try:
        return constant(value)
    except ExpressionError as error:
        raise ValueError(f"expected a number, got '{value}': {error}") from error


Real = Annotated[float, _FiniteReal()]
"""A finite number; in a configuration also a constant expression."""
