"""Numbers in sentences of the pages, by name; the results in docs/data have them."""

from collections.abc import Callable

from results import row


def _variation(norm: str) -> str:
    return f"{row('jacobian', 'variation', norm=norm)['value']:.5f}"


VALUES: dict[str, Callable[[], str]] = {
    "jacobian.frobenius": lambda: _variation("frobenius"),
    "jacobian.two": lambda: _variation("two"),
}
