"""Templates of the pages that commands write."""

from __future__ import annotations

from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined


def decimals(value: float | None, digits: int) -> str:
    # Adding 0 turns -0.0, which rounding can give, into 0.0.
    return "-" if value is None else f"{round(value, digits) + 0.0:.{digits}f}"


def exponent(value: float | None) -> str:
    return "-" if value is None else f"{value:.0e}" if value else "0"


_ENVIRONMENT = Environment(
    loader=PackageLoader("dsnet.pictures"),
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    keep_trailing_newline=True,
    # Markdown is escaped when it is rendered; the HTML template marks its body as safe.
    autoescape=lambda name: bool(name and name.endswith(".html.j2")),
)
_ENVIRONMENT.filters |= {"decimals": decimals, "exponent": exponent}


def fill_template(template: str, **variables: Any) -> str:
    """Fill one of the templates in `dsnet/pictures/templates`."""
    return _ENVIRONMENT.get_template(template).render(variables)
